"""Kills processes at random moments and brings them back, by a seed."""

import random
import threading
import time
from dataclasses import dataclass

from stage import Stage, wait_until


@dataclass
class Kill:
    victim: str
    pause: float  # before it, in seconds
    away: float  # after it
    when: float = 0.0  # seconds since 1970
    back: float = 0.0


def plan(seed: int, kills: int, names: list[str], pause: float) -> list[Kill]:
    """Who dies when: each process about as often as the others, in random order."""
    moments = random.Random(seed)
    victims: list[str] = []
    while len(victims) < kills:
        victims += moments.sample(names, len(names))
    return [
        Kill(victim, pause * moments.uniform(0.3, 1.7), moments.uniform(0.2, 3.0))
        for victim in victims[:kills]
    ]


class Killer:
    """Carries a plan out in a thread of its own. Victims come back by themselves: the next may die
    before one does."""

    def __init__(self, stage: Stage, kills: list[Kill]) -> None:
        self.kills = kills
        self.problems: list[str] = []
        self._stage = stage
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._nurses: list[threading.Thread] = []

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._ended.set()
        self._thread.join()

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def _run(self) -> None:
        for kill in self.kills:
            if self._ended.wait(kill.pause):
                break
            self._await_alive(kill.victim)
            died = self._stage.died() if not self._absent() else []
            self.problems += died
            self._stage.parts[kill.victim].kill()
            kill.when = time.time()
            nurse = threading.Thread(target=self._revive, args=(kill,), daemon=True)
            nurse.start()
            self._nurses.append(nurse)
        for nurse in self._nurses:
            nurse.join()

    def _absent(self) -> bool:
        return any(nurse.is_alive() for nurse in self._nurses)

    def _await_alive(self, victim: str) -> None:
        wait_until(lambda: self._stage.parts[victim].alive, 30, f"{victim} is back")

    def _revive(self, kill: Kill) -> None:
        time.sleep(kill.away)
        if kill.victim.startswith("coordinator"):
            # Without its store it does not start; who runs it would try again.
            wait_until(self._stage.redis_answers, 60, "redis answers")
        self._stage.parts[kill.victim].start()
        kill.back = time.time()
