"""Coordinates that chains draw, beside the dimension of the deepest path."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rendering import by_metrofarm
from variants import DELAYED, PLAIN, BenchScene, ours

PAIR = 2
# Longest path in edges where nothing limits it (worker/primary_space/slots.h).
LONGEST_PATH = 512


def path_dimension(edges: int, lens: int) -> int:
    """Film, lens; at each inner vertex a lobe (with the roulette), a direction, a light and a point
    on it. The pairs are those of worker/primary_space/slots.h."""
    return PAIR * (1 + lens + 4 * (edges - 1))


def bidirectional_dimension(edges: int, lens: int) -> int:
    """An eye subpath as above, and a light subpath: a light, a point, a direction; at each further
    vertex that scatters a lobe and a direction."""
    return path_dimension(edges, lens) + PAIR * (3 + 2 * max(0, edges - 2))


def multiplexed_dimension(edges: int, lens: int) -> int:
    """Length and technique; then the technique that reads most: the eye subpath alone, without
    light sampling. A sampler that does not know the technique would need both subpaths."""
    return PAIR * (1 + 1 + lens + 2 * (edges - 1))


@dataclass(frozen=True)
class Chains:
    name: str
    words: tuple[str, ...]
    dimension: Callable[[int, int], int]


CHAINS = [
    Chains("pssmlt over path", ("pssmlt",), path_dimension),
    Chains("pssmlt over bdpt", ("pssmlt", "--under", "bdpt"), bidirectional_dimension),
    Chains("mmlt", ("mmlt",), multiplexed_dimension),
]


@dataclass(frozen=True)
class Row:
    """drawn: coordinates per mutation; with delayed rejection per path evaluation, because second
    stages draw too."""

    scene: str
    chains: str
    edges: int
    dimension: int
    drawn: float
    drawn_delayed: float
    evaluations_delayed: float

    @property
    def saved(self) -> float:
        return 1 - self.drawn / self.dimension


def draw(scene: BenchScene, words: tuple[str, ...], per_pixel: int) -> Any:
    return by_metrofarm(scene, ours("chains", *words), per_pixel, 1)[1]


def evaluations_per_mutation(stats: Any) -> float:
    bootstrap = int(stats["resolved_spec"]["bootstrapSamples"])
    return (stats["path_evaluations"] - bootstrap) / stats["mutations"]


def row(scene: BenchScene, chains: Chains, per_pixel: int) -> Row:
    plain = draw(scene, (*chains.words, *PLAIN), per_pixel)
    delayed = draw(scene, (*chains.words, *DELAYED), per_pixel)
    limit = plain["resolved_spec"]["maxDepth"]
    edges = LONGEST_PATH if limit < 0 else min(limit, LONGEST_PATH)
    features = {feature["name"]: feature["state"] for feature in plain["plan"]["features"]}
    evaluations = evaluations_per_mutation(delayed)
    return Row(
        scene.name,
        chains.name,
        edges,
        chains.dimension(edges, int(features["lens"] == "used")),
        plain["coordinates_per_mutation"],
        delayed["coordinates_per_mutation"] / evaluations,
        evaluations,
    )


def table(rows: list[Row]) -> str:
    lines = [
        "| scene | chains | deepest path, edges | its dimension | drawn per mutation | saved | "
        "with delayed rejection: drawn per evaluation | evaluations per mutation |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for r in rows:
        cells = [r.scene, r.chains, str(r.edges), str(r.dimension), f"{r.drawn:.1f}"]
        cells += [f"{r.saved:.0%}", f"{r.drawn_delayed:.1f}", f"{r.evaluations_delayed:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
