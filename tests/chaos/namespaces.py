"""A network namespace with one cable to the host, which can be pulled."""

import os
import subprocess
from types import TracebackType


def refusal() -> str:
    """Why there can be none here; nothing if there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    try:
        with Namespace("mfprobe", 253):
            return ""
    except FileNotFoundError:
        return "there is no program ip (Debian: iproute2)"
    except subprocess.CalledProcessError as error:
        return f"no network namespace can be made here: {error.stderr.decode().strip()}"


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Namespace:
    """Gone with all that is in it when the block ends. number tells networks apart, 0 to 253."""

    def __init__(self, name: str, number: int) -> None:
        self.name = f"{name}-{os.getpid()}"
        self.prefix = ["ip", "netns", "exec", self.name]
        self.host = f"198.18.{number}.1"  # reserved for tests of networks
        self._inside = f"198.18.{number}.2"
        self._ends = (f"mfh{number}", f"mfn{number}")

    def __enter__(self) -> "Namespace":
        outer, inner = self._ends
        ip("netns", "add", self.name)
        try:
            ip("link", "add", outer, "type", "veth", "peer", "name", inner, "netns", self.name)
            ip("address", "add", f"{self.host}/30", "dev", outer)
            ip("link", "set", outer, "up")
            ip("-n", self.name, "address", "add", f"{self._inside}/30", "dev", inner)
            self.plug()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        subprocess.run(["ip", "link", "delete", self._ends[0]], check=False, capture_output=True)
        subprocess.run(["ip", "netns", "delete", self.name], check=False, capture_output=True)

    def pull(self) -> None:
        ip("-n", self.name, "link", "set", self._ends[1], "down")

    def plug(self) -> None:
        ip("-n", self.name, "link", "set", self._ends[1], "up")
