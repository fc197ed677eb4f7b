"""The table of figures about the plugin scenes, printed when all tests have run."""

import numpy as np
import pytest

from blocks import LEVELS, Verdict
from plugin_replicas import Work

ROWS = pytest.StashKey[list[str]]()
HEADINGS = (
    f"{'':42} {'largest |t|':^31} {'smallest':>9} {'reveals %':^15}\n"
    f"{'scene':42} {'pixel':>7} {'tile':>7} {'quarter':>7} {'whole':>7} {'p / alpha':>9} "
    f"{'whole':>7} {'tile':>7}  replicas x samples"
)


def row(name: str, verdicts: dict[str, Verdict], work: Work) -> str:
    def column(level: str, figure: str) -> str:
        return figure.rjust(7) if level in verdicts else "-".rjust(7)

    def largest(level: str) -> str:
        return column(level, f"{np.abs(verdicts[level].t).max():.1f}" if level in verdicts else "")

    def reveals(level: str) -> str:
        known = level in verdicts
        return column(level, f"{100 * verdicts[level].typical_detectable:.2f}" if known else "")

    p = min(float(verdict.p_values.min() / verdict.threshold) for verdict in verdicts.values())
    return (
        f"{name:42} {' '.join(map(largest, LEVELS))} {p:9.1e} {reveals('whole')} "
        f"{reveals('tile')}  {work.replicas} x {work.per_pixel} "
        f"{'' if all(verdict.agrees for verdict in verdicts.values()) else 'DIFFERS'}"
    )
