#!/usr/bin/env python3
"""Plants one bug at a time and checks that its test turns red (`make sabotage`).

usage: sabotage.py [NAME ...] [--tree DIR]

Each NAME.patch in this directory is a diff against the repository's root with a header:

    # what: one line, the bug
    # red: the command that must fail with the bug planted (run from the root)
    # build: worker | services | nothing     what to compile before it


The tree is copied once (with what is not committed, without build output), built once without any
bug, and each command must pass there first: a test that is red anyway proves nothing. Then each
patch is applied, the changed part compiled again, the command run, and the patch taken back.
A patch that no longer applies, or a bug that does not compile, fails like a green test.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
LEFT_OUT = shutil.ignore_patterns(
    ".git", "build", "build-*", "bin", "demo", "node_modules", "__pycache__", ".pytest_cache"
)
BUILDS = {
    "worker": ["make", "worker", "worker-tests"],
    "services": ["make", "services"],
    "nothing": None,
}


@dataclass(frozen=True)
class Sabotage:
    name: str
    patch: Path
    what: str
    red: str
    build: str


@dataclass(frozen=True)
class Outcome:
    sabotage: Sabotage
    caught: bool
    note: str
    seconds: float


def read_sabotage(patch: Path) -> Sabotage:
    header: dict[str, str] = {}
    for line in patch.read_text().splitlines():
        if not line.startswith("# "):
            break
        key, _, value = line[2:].partition(":")
        header[key] = value.strip()
    missing = {"what", "red", "build"} - header.keys()
    if missing:
        raise ValueError(f"{patch.name}: no '# {'', '# '.join(sorted(missing))}' in its header")
    if header["build"] not in BUILDS:
        raise ValueError(f"{patch.name}: build: {header['build']} is none of {', '.join(BUILDS)}")
    return Sabotage(patch.stem, patch, header["what"], header["red"], header["build"])


def copy_tree(into: Path) -> None:
    """A copy that shares the installed tools; they are never written to."""
    shutil.copytree(
        ROOT, into, ignore=lambda d, names: {*LEFT_OUT(d, names), ".tools"}, symlinks=True
    )
    if (ROOT / ".tools").exists():
        (into / ".tools").symlink_to(ROOT / ".tools")


class Tree:
    """The copy, and commands in it."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def run(self, command: str | list[str]) -> subprocess.CompletedProcess[str]:
        tools = ROOT / ".tools"
        path = os.pathsep.join(
            [str(tools / "bin"), str(tools / "python/bin"), str(tools / "go"), os.environ["PATH"]]
        )
        return subprocess.run(
            command,
            shell=isinstance(command, str),
            cwd=self.root,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PATH": path, "GOTOOLCHAIN": "local"},
        )

    def build(self, what: str) -> subprocess.CompletedProcess[str] | None:
        command = BUILDS[what]
        return None if command is None else self.run(command)

    def patch(self, patch: Path, *flags: str) -> subprocess.CompletedProcess[str]:
        # Outside of a repository git apply works on plain files; it must not find one above.
        ceiling = f"GIT_CEILING_DIRECTORIES={self.root.parent}"
        return self.run(["env", ceiling, "git", "apply", *flags, str(patch)])


def tail(done: subprocess.CompletedProcess[str], lines: int = 15) -> str:
    return "\n".join((done.stdout + done.stderr).splitlines()[-lines:])


def plant(tree: Tree, sabotage: Sabotage) -> tuple[bool, str]:
    """Whether the test turned red, and what happened."""
    applied = tree.patch(sabotage.patch)
    if applied.returncode != 0:
        return False, "the patch does not apply: " + tail(applied)
    try:
        built = tree.build(sabotage.build)
        if built is not None and built.returncode != 0:
            return False, "does not compile with the bug:\n" + tail(built)
        tested = tree.run(sabotage.red)
        if tested.returncode == 0:
            return False, f"stayed green: {sabotage.red}"
        return True, "turned red: " + tail(tested, 1)
    finally:
        tree.patch(sabotage.patch, "--reverse")


def prepare(tree: Tree, chosen: list[Sabotage]) -> None:
    """Builds without a bug; every command must be green then."""
    for what in BUILDS:  # tests of one part may run the other
        built = tree.build(what)
        if built is not None and built.returncode != 0:
            sys.exit(f"the tree does not build without any bug:\n{tail(built, 40)}")
    for command in sorted({sabotage.red for sabotage in chosen}):
        done = tree.run(command)
        if done.returncode != 0:
            sys.exit(f"red without any bug: {command}\n{tail(done, 40)}")


def sabotage_all(tree: Tree, chosen: list[Sabotage]) -> list[Outcome]:
    outcomes = []
    for sabotage in chosen:
        started = time.monotonic()
        caught, note = plant(tree, sabotage)
        outcomes.append(Outcome(sabotage, caught, note, time.monotonic() - started))
        print(f"{sabotage.name}: {note}", flush=True)
    return outcomes


def report(outcomes: list[Outcome]) -> bool:
    """Prints the table; True when every bug was caught."""
    width = max(len(outcome.sabotage.name) for outcome in outcomes)
    print()
    for outcome in outcomes:
        verdict = "caught" if outcome.caught else "MISSED"
        name = outcome.sabotage.name.ljust(width)
        print(f"{verdict}  {name}  {outcome.seconds:5.0f} s  {outcome.sabotage.what}")
    caught = sum(outcome.caught for outcome in outcomes)
    print(f"{caught} of {len(outcomes)} planted bugs turned a test red")
    return caught == len(outcomes)


def choose(names: list[str], directory: Path) -> list[Sabotage]:
    patches = {patch.stem: patch for patch in sorted(directory.glob("*.patch"))}
    unknown = set(names) - patches.keys()
    if unknown or not patches:
        sys.exit(f"no such patch: {', '.join(sorted(unknown)) or directory}")
    return [read_sabotage(patches[name]) for name in names or patches]


def main() -> None:
    parser = argparse.ArgumentParser(description="plant bugs; each must turn a test red")
    parser.add_argument("names", nargs="*", help="patches to plant; all by default")
    parser.add_argument("--tree", type=Path, help="keep the copy and its build here")
    arguments = parser.parse_args()
    chosen = choose(arguments.names, HERE)
    with tempfile.TemporaryDirectory(prefix="metrofarm-sabotage-") as scratch:
        root = arguments.tree or Path(scratch) / "tree"
        if not root.exists():
            copy_tree(root)
        tree = Tree(root)
        prepare(tree, chosen)
        if not report(sabotage_all(tree, chosen)):
            sys.exit(1)


if __name__ == "__main__":
    main()
