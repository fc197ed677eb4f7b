"""Writes the figures of the long load test for people."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt

from loading import film_bytes

mpl.use("Agg")
MB, GB = 1e6, 1e9
# What the arithmetic is about.
WORKERS = 1000
CORES = (2, 8, 32)


def table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def sweep_table(sweep: list[dict[str, Any]]) -> str:
    rows = []
    for s in sweep:
        lease, deliver = s["latency_seconds"]["Lease"], s["latency_seconds"]["Deliver"]
        report = s["latency_seconds"].get("Report", {"p50": 0, "p99": 0})
        rate = s["batches_per_second"]
        rows.append(
            [
                str(s["workers"]),
                f"{s['workers'] / s['render_seconds']:.1f}",
                f"{rate:.2f}",
                f"{rate * s['film']['packed_bytes'] / MB:.0f}",
                f"{rate * s['film']['unpacked_bytes'] / MB:.0f}",
                f"{s['cpu_seconds_per_batch']:.3f}",
                f"{rate * s['cpu_seconds_per_batch']:.2f}",
                f"{lease['p50'] * 1e3:.0f} / {lease['p99'] * 1e3:.0f}",
                f"{report['p50'] * 1e3:.0f} / {report['p99'] * 1e3:.0f}",
                f"{deliver['p50']:.2f} / {deliver['p99']:.2f}",
                f"{s['peak_rss'] / GB:.2f}",
            ]
        )
    header = ["workers", "offered, batches/s", "merged, batches/s", "packed MB/s", "unpacked MB/s"]
    header += [
        "coordinator's CPU s per batch",
        "cores it got",
        "lease p50 / p99, ms",
        "report p50 / p99, ms",
    ]
    header += ["delivery p50 / p99, s", "peak memory, GB"]
    return table(header, rows)


def limits_table(limits: dict[str, Any]) -> str:
    rows = []
    for size, limit in limits.items():
        film = limit["film"]
        rates = [limit[name] for name in ("memory_copied", "zstd_unpacked", "merged")]
        rows.append(
            [
                size,
                f"{film['packed_bytes'] / MB:.1f}",
                f"{film['unpacked_bytes'] / MB:.0f}",
                f"{100 * film['share_of_tiles']:.0f} %",
                f"{100 * film['share_of_values_not_zero']:.0f} %",
                f"{film['render_cpu_seconds']:.2f}",
                *(
                    f"{r['one_thread'] / GB:.2f} / {r['two_threads'] / GB:.2f} "
                    f"({r['one_thread_per_cpu_second'] / GB:.2f})"
                    for r in rates
                ),
            ]
        )
    header = ["film", "packed MB", "unpacked MB", "tiles with light", "values not 0 in them"]
    header += [
        "CPU s to render",
        "memory copied, GB/s",
        "zstd alone, GB/s",
        "unpack, check, add, GB/s",
    ]
    return table(header, rows)


def batch_cost(figures: dict[str, Any], size: str) -> float:
    """The coordinator's CPU seconds for a batch: measured at 1080p, elsewhere by unpacked bytes."""
    measured = best_step(figures["sweep"])["cpu_seconds_per_batch"]
    films = {name: limit["film"]["unpacked_bytes"] for name, limit in figures["limits"].items()}
    return measured * films[size] / films["1080p"]


def best_step(sweep: list[dict[str, Any]]) -> dict[str, Any]:
    """The step with the highest rate."""
    return max(sweep, key=lambda s: s["batches_per_second"])


def arithmetic_table(figures: dict[str, Any]) -> str:
    rows = []
    for size, limit in figures["limits"].items():
        film, cost = limit["film"], batch_cost(figures, size)
        for kind, share in (("as recorded", 1.0), ("light in every tile", film["share_of_tiles"])):
            intervals = [f"{WORKERS * cost / share / cores:.0f} s" for cores in CORES]
            # Both bytes and cost grow by 1 / share.
            packed = film["packed_bytes"] * CORES[1] / cost / MB
            rows.append([f"{size}, {kind}", f"{cost / share:.2f}", *intervals, f"{packed:.0f}"])
    header = ["batches", "CPU s each"]
    header += [f"sealing interval, {cores} cores" for cores in CORES]
    header += [f"packed MB/s then, {CORES[1]} cores"]
    return table(header, rows)


def crowd_lines(crowd: dict[str, Any]) -> str:
    grown = (crowd["peak_rss"] - crowd["idle_rss"]) / 2**20
    lease = crowd["latency_seconds"]["Lease"]
    return f"""{crowd["jobs"]} queued jobs and {crowd["clients"]} idle event streams cost
{grown:.0f} MiB beside the {crowd["idle_rss"] / 2**20:.0f} MiB of an idle coordinator (at most 200).
With them:

- a page of 100 jobs takes {crowd["list_seconds_p50"] * 1e3:.0f} ms, the longest of 20
  {crowd["list_seconds_longest"] * 1e3:.0f} ms;
- submitting a job takes {crowd["submit_seconds_per_job"] * 1e3:.0f} ms;
- a lease for one of 20 workers at work takes {lease["p50"] * 1e3:.0f} ms, p99
  {lease["p99"] * 1e3:.0f} ms.
"""


def introduction(figures: dict[str, Any]) -> str:
    m, best = figures["machine"], best_step(figures["sweep"])
    return f"""# One coordinator under load

Written by `make load` on {m["date"]}, commit {m["commit"]}: {m["cores"]} cores of {m["cpu"]},
{m["memory_bytes"] / GB:.0f} GB, Linux {m["kernel"]}, {m["go"]}. The load average was
{m["load_average_before"]:.1f} before the run, without its load: above {m["cores"]} the machine did
other work too, so read CPU seconds before rates by the wall clock. Coordinator and simulated
workers share the cores.

Batches are films of door-ajar (PSSMLT, two layers) that a real worker with one thread delivered,
as many in one as took it {best["film"]["render_cpu_seconds"]:.1f} CPU seconds. Simulated workers
deliver them over gRPC without TLS, one at a time, {best["render_seconds"]:.0f} s after each
lease.
"""


def memory_lines(memory: dict[str, Any]) -> str:
    film = memory["film"]
    sums = film_bytes(film["width"], film["height"]) / GB
    size = f"{film['width']}x{film['height']}"
    return f"""{memory["workers"]} workers for {memory["seconds"]:.0f} s at saturation,
{memory["accepted"]} batches of a job at {size} that had {memory["rounds_before"]} complete rounds
before, and whose rounds close several times a minute:
over that time the live heap changes by {100 * memory["live_growth"]:+.1f} %
(Theil and Sen's slope), resident memory by {100 * memory["rss_growth"]:+.1f} %. Collections and
rounds alone would give up to {100 * memory["live_noise"]:.1f} and
{100 * memory["rss_noise"]:.1f} % in 99 of 100 such runs (blocks of 20 s in random order). At most
{memory["peak_rss"] / GB:.2f} GB were resident.
The sums of a film of this size take {sums:.3f} GB; a job has three films, and copies of the
tiles that change while a snapshot is folded, hashed or written.
"""


def saturation_lines(figures: dict[str, Any]) -> str:
    best, cores = best_step(figures["sweep"]), figures["machine"]["cores"]
    cost, simulation = best["cpu_seconds_per_batch"], best["cpu_seconds"] / best["accepted"]
    got = best["batches_per_second"] * cost
    limit = figures["limits"]["1080p"]
    tiles = limit["film"]["unpacked_bytes"] / limit["merged"]["one_thread_per_cpu_second"]
    zstd = limit["film"]["unpacked_bytes"] / limit["zstd_unpacked"]["one_thread_per_cpu_second"]
    return f"""At most {best["batches_per_second"]:.1f} batches per second were merged, while the
coordinator got {got:.1f} cores. Each takes it {cost:.2f} CPU seconds; by the figures below
{tiles:.2f} of them unpack, check and add the tiles, and {zstd:.2f} of those are zstd's. The
simulation takes {simulation:.2f} CPU seconds for each. So the coordinator saturates at
{1 / cost:.1f} batches per second and core, {cores / cost:.1f} on {cores} cores of its own.
Every batch was answered committed or, where a segment is checked, duplicate. At saturation lease
calls last long on purpose: leases are withheld until batches that wait have been merged.
"""


def text(figures: dict[str, Any]) -> str:
    return f"""{introduction(figures)}
## Saturation at 1920x1080

{sweep_table(figures["sweep"])}
![throughput and latency against workers](load.png)

{saturation_lines(figures)}
## Limits beside it

On one thread / on two (one thread, per CPU second); rates of films in unpacked bytes.

{limits_table(figures["limits"])}
## Memory

{memory_lines(figures["memory"])}
## A crowd that waits

{crowd_lines(figures["crowd"])}
## By arithmetic: {WORKERS} real workers on one coordinator

A coordinator of C cores merges C / (CPU s per batch) batches per second, so {WORKERS} workers have
to seal each {WORKERS} x (CPU s per batch) / C seconds at the least. Cost grows with unpacked bytes,
that is with the tiles that have light, up to all of them. Packed bytes grow with the interval too,
up to those of a dense film, which the last column leaves out. 4K is 1080p by unpacked bytes.

{arithmetic_table(figures)}
Below these intervals a farm needs more coordinators, each with jobs of its own.
"""


def plot(figures: dict[str, Any], path: Path) -> None:
    sweep, memory = figures["sweep"], figures["memory"]
    workers = [s["workers"] for s in sweep]
    figure, (rates, latencies, rss) = plt.subplots(1, 3, figsize=(13, 3.8), layout="constrained")
    rates.plot(workers, [s["batches_per_second"] for s in sweep], "o-", label="merged")
    offered = [s["workers"] / s["render_seconds"] for s in sweep]
    rates.plot(workers, offered, "--", color="gray", label="offered")
    alone = [figures["machine"]["cores"] / s["cpu_seconds_per_batch"] for s in sweep]
    rates.plot(workers, alone, ":", color="gray", label="with all cores")
    rates.set_ylim(0, 1.2 * max(alone))
    rates.set_ylabel("batches per second")
    for method, mark in (("Lease", "o"), ("Heartbeat", "s"), ("Deliver", "^")):
        for quantile, line in (("p50", "-"), ("p99", ":")):
            seconds = [s["latency_seconds"][method][quantile] for s in sweep]
            latencies.plot(workers, seconds, mark + line, label=f"{method} {quantile}")
    latencies.set_yscale("log")
    latencies.set_ylabel("seconds")
    rss.plot([t for t, _ in memory["rss"]], [n / GB for _, n in memory["rss"]])
    rss.plot([t for t, _ in memory["live"]], [n / GB for _, n in memory["live"]])
    rss.legend(
        ["resident", "live heap"],
        fontsize="small",
        loc="upper left",
        bbox_to_anchor=(0, -0.18),
        ncols=2,
    )
    rss.set_ylim(bottom=0)
    rss.set_xlabel(f"seconds, {memory['workers']} workers")
    rss.set_ylabel("GB")
    for axes in (rates, latencies):
        axes.set_xlabel("simulated workers")
        axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(0, -0.18), ncols=3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def write_report(figures: dict[str, Any], folder: Path) -> None:
    plot(figures, folder / "load.png")
    (folder / "load.md").write_text(text(figures))
