"""The report in words and tables. What it concludes is computed, so that it stays true."""

import statistics
from collections.abc import Callable, Sequence

import numpy as np
from convergence import LEVEL, Estimate
from plates import SAMPLINGS, SIGMAS, Chains, Run
from sequence import Fit, Sequences

Runs = dict[Chains | str, list[Run]]  # of path tracing by light sampling


def median(runs: Sequence[Run], figure: Callable[[Run], float]) -> float:
    return statistics.median(figure(run) for run in runs)


def work(run: Run) -> float:
    """Constant while the error falls as one over the path evaluations: smaller is better."""
    return run.relative_mse * run.evaluations


def rmse(runs: Sequence[Run]) -> float:
    return float(np.sqrt(median(runs, lambda run: run.mse)))


def ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


def error_cells(runs: Sequence[Run]) -> list[str]:
    cells = [f"{rmse(runs):.4g}", f"{median(runs, lambda run: run.relative_mse):.3g}"]
    cells += [f"{median(runs, lambda run: run.evaluations):.1f}", f"{median(runs, work):.3g}"]
    return [*cells, f"{median(runs, lambda run: run.cpu_seconds):.2f}"]


ERROR_HEADINGS = "RMSE | relMSE | evaluations | relMSE x evaluations | CPU s"


def joined(lines: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def sigma_row(sampling: str, chains: Chains | None, runs: Sequence[Run]) -> list[str]:
    if chains is None:
        return [sampling, "path tracing", "", *error_cells(runs), "", ""]
    name = "delayed rejection" if chains.delayed else "PSSMLT"
    accepted = [ratio(runs[0].acceptance[stage]) for stage in ("small", "second")]
    return [sampling, name, f"{chains.sigma:g}", *error_cells(runs), *accepted]


def sigma_table(runs: Runs) -> str:
    heading = (
        f"| light sampling | by | sigma | {ERROR_HEADINGS} | small steps accepted | "
        "second stages accepted |\n| --- | --- | ---: |" + " ---: |" * 7 + "\n"
    )
    lines = []
    for sampling in SAMPLINGS:
        lines.append(sigma_row(sampling, None, runs[sampling]))
        for delayed in (False, True):
            for sigma in SIGMAS:
                chains = Chains(sampling, sigma, delayed)
                lines.append(sigma_row(sampling, chains, runs[chains]))
    return heading + joined(lines)


def sigma_findings(runs: Runs) -> str:
    lines = []
    for sampling in SAMPLINGS:
        cost = {key: median(runs[key], work) for key in runs if isinstance(key, Chains)}
        plain = {s: cost[Chains(sampling, s, False)] for s in SIGMAS}
        delayed = {s: cost[Chains(sampling, s, True)] for s in SIGMAS}
        gains = ", ".join(f"{plain[s] / delayed[s]:.2f} at {s:g}" for s in SIGMAS)
        best_plain, best_delayed = (
            min(plain, key=plain.__getitem__),
            min(delayed, key=delayed.__getitem__),
        )
        path = median(runs[sampling], work)
        lines.append(
            f"- {sampling}: the best sigma is {best_plain:g}, with delayed rejection "
            f"{best_delayed:g}. Evaluations that PSSMLT needs over those that delayed rejection "
            f"needs to the same error (above 1: delayed rejection wins): {gains}; each at its own "
            f"best sigma {plain[best_plain] / delayed[best_delayed]:.2f}. Path tracing over the "
            f"best of the chains: {path / min(plain[best_plain], delayed[best_delayed]):.2f}."
        )
    return "\n".join(lines)


def sequence_table(sequences: Sequences) -> str:
    heading = f"| | mutations | {ERROR_HEADINGS} |\n| --- | ---: |" + " ---: |" * 5 + "\n"
    lines = []
    for chains, levels in sequences.runs.items():
        for runs in levels:
            count = f"{median(runs, lambda run: run.mutations):.0f}"
            lines.append([chains.name, count, *error_cells(runs)])
    return heading + joined(lines)


def interval(e: Estimate, scale: float = 1.0, digits: int = 3) -> str:
    reach = scale * (e.high - e.value)
    return f"{scale * e.value:.{digits}f} ± {reach:.{digits}f}"


def fit_table(fits: dict[Chains, dict[str, Fit]]) -> str:
    heading = (
        "| | measure | slope | standard error | floor, % of the last MSE | error of the mean, % |\n"
        "| --- | --- |" + " ---: |" * 4 + "\n"
    )
    lines = []
    for chains, by_measure in fits.items():
        for measure, fit in by_measure.items():
            cells = [chains.name, measure, interval(fit.slope), f"{fit.slope.standard_error:.4f}"]
            cells += [interval(fit.floor_share, 100, 1), interval(fit.of_mean, 100, 1)]
            lines.append(cells)
    return heading + joined(lines)


def bright_findings(shares: list[float]) -> str:
    return (
        f"The brightest hundredth of the pixels carries {min(shares):.0%} to {max(shares):.0%} of "
        "the squared error of an image at the last count. So few pixels decide the RMSE, which "
        "scatters widely; relMSE weighs pixels alike. An image whose chains have hardly met the "
        "smallest light lacks a bounded amount: that makes a slope shallower than -1/2 at few "
        "mutations without any floor. The error of the mean, which compares no two counts, is "
        "free of it."
    )


def listed(fits: dict[Chains, dict[str, Fit]], off: Callable[[Fit], bool]) -> str:
    found = [
        f"{chains.name} ({measure})"
        for chains, by_measure in fits.items()
        for measure, fit in by_measure.items()
        if off(fit)
    ]
    return ", ".join(found) or "none"


def sequence_findings(sequences: Sequences, fits: dict[Chains, dict[str, Fit]], seeds: int) -> str:
    last = {chains: median(levels[-1], work) for chains, levels in sequences.runs.items()}
    gains = ", ".join(
        f"{last[chains] / last[Chains(chains.sampling, chains.sigma, True)]:.2f} with "
        f"{chains.sampling}"
        for chains in last
        if not chains.delayed
    )
    whole = sum(len(by_measure) for by_measure in fits.values())
    return (
        f"Of {whole} fits, slopes whose {LEVEL:.0%} interval excludes -1/2: "
        f"{listed(fits, lambda fit: not fit.slope.contains(-0.5))}. Floors whose interval excludes "
        f"0: {listed(fits, lambda fit: not fit.floor_share.contains(0.0))}. Errors of the mean "
        f"whose interval excludes {1 / seeds:.1%}: "
        f"{listed(fits, lambda fit: not fit.of_mean.contains(1 / seeds))}. At the last "
        "step PSSMLT needs so many times the evaluations of delayed rejection to the same relMSE: "
        f"{gains}."
    )
