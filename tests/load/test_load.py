"""The short form of the load test; load.py beside this file is the long one."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from loading import MIB, LoadedFarm, accepted, build, film_bytes, growth, noise, queue_up

WIDTH, HEIGHT = 480, 270
WORKERS = 100
# Batches of a real worker that make one of a simulated one.
RECORDED = 8
# Go's collector lets garbage grow to the size of what lives.
COLLECTED = 2


@pytest.fixture
def make_loaded(tmp_path: Path) -> Iterator[Callable[[str], LoadedFarm]]:
    build()
    with ExitStack() as stack:

        def make(name: str) -> LoadedFarm:
            farm = LoadedFarm(tmp_path / name)
            stack.callback(farm.close)
            return farm

        yield make


def memory_bound(loaded: LoadedFarm, film: dict[str, int]) -> float:
    """The sums of the complete rounds and of two open ones, as many again for snapshots of them,
    and the batches that are unpacked at a time."""
    batches = loaded.counted("metrofarm_merge_slots")
    batch = film["unpacked_bytes"] + film["packed_bytes"]
    return COLLECTED * (6 * film_bytes(WIDTH, HEIGHT) + batches * batch) + 200 * MIB


def test_a_crowd(make_loaded: Callable[[str], LoadedFarm]) -> None:
    """A thousand queued jobs and two hundred clients that watch them cost little. With them, all
    that a hundred workers deliver is counted, nobody waits long for a lease, and memory has a
    bound."""
    studio = make_loaded("studio")
    film = studio.folder / "film.rec"
    studio.record(film, WIDTH, HEIGHT, RECORDED)
    studio.close()

    loaded = make_loaded("crowded")
    with ExitStack() as stack:
        loaded.submit_long(WIDTH, HEIGHT)
        crowd = queue_up(stack, loaded, jobs=1000, clients=200)
        print(crowd)
        assert crowd["peak_rss"] - crowd["idle_rss"] < 200 * MIB
        assert crowd["list_seconds_p50"] < 0.5

        # The first job starts with few workers, so that the others need no second one.
        loaded.load(film, "-workers", "4", "-render", "100ms", "-warmup", "0s", "-for", "3s")
        options = ["-sum", str(RECORDED), "-segments", "8"]
        options += ["-workers", str(WORKERS), "-render", "5s", "-for", "10s"]
        result = loaded.load(film, *options)
    print({name: value for name, value in result.items() if name != "samples"})
    assert accepted(result) > WORKERS / 5
    assert result["latency_seconds"]["Lease"]["p50"] < 1
    assert result["peak_rss"] < memory_bound(loaded, result["film"])


def test_growth_finds_a_leak_among_collections() -> None:
    """The instrument of the long form: saw teeth are no growth, saw teeth on a slope are."""

    def teeth(leak_per_second: float) -> list[tuple[float, float]]:
        sizes = [1e9 + 3e8 * (i % 7) / 7 + leak_per_second * 2 * i for i in range(100)]
        return [(2.0 * i, size) for i, size in enumerate(sizes)]

    assert growth(teeth(0)) <= noise(teeth(0))
    assert growth(teeth(2e6)) > noise(teeth(2e6))
