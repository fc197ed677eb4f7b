"""Contact sheets and plots of the report."""

import io
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.ticker import NullFormatter

DPI = 100
SHOWN_WIDTH = 192  # pixels
COLOURS = 256


def tone_mapped(image: np.ndarray, exposure: float) -> np.ndarray:
    """sRGB in [0, 1]."""
    linear = np.clip(exposure * image, 0.0, 1.0)
    curve = 1.055 * np.power(linear, 1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def contact_sheet(
    rows: Sequence[Sequence[tuple[str, np.ndarray]]], exposure: float, out: Path
) -> None:
    """Labelled images of one size, magnified without smoothing, in a palette that keeps the file
    small."""
    height, width = rows[0][0][1].shape[:2]
    times = max(1, round(SHOWN_WIDTH / width))
    gap, label = 6, 24
    shown = (times * width, times * height)
    columns = max(len(row) for row in rows)
    size = (columns * (shown[0] + gap), len(rows) * (shown[1] + label))
    figure = pyplot.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
    for i, row in enumerate(rows):
        for j, (title, image) in enumerate(row):
            left = (j * (shown[0] + gap) + gap / 2) / size[0]
            bottom = 1 - (i + 1) * (shown[1] + label) / size[1]
            box = (left, bottom, shown[0] / size[0], shown[1] / size[1])
            axes = figure.add_axes(box)
            axes.imshow(tone_mapped(image, exposure), interpolation="nearest")
            axes.set_title(title, fontsize=7, pad=3)
            axes.set_axis_off()
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=DPI, format="png")
    pyplot.close(figure)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(out, optimize=True)


Points = Sequence[tuple[float, Sequence[float]]]  # mutations per pixel, RMSE of each seed


def sequence_plot(panels: Mapping[str, Mapping[str, Points]], out: Path) -> None:
    """Medians with the smallest and largest, and a line that falls as the inverse root."""
    figure, all_axes = pyplot.subplots(1, len(panels), figsize=(5 * len(panels), 4.2))
    for axes, (measure, by_name) in zip(all_axes, panels.items(), strict=True):
        for name, points in by_name.items():
            counts = [count for count, _ in points]
            middle = [statistics.median(errors) for _, errors in points]
            below = [m - min(errors) for m, (_, errors) in zip(middle, points, strict=True)]
            above = [max(errors) - m for m, (_, errors) in zip(middle, points, strict=True)]
            axes.errorbar(counts, middle, (below, above), marker="o", markersize=3, label=name)
        first = next(iter(by_name.values()))
        ends = np.array([first[0][0], first[-1][0]])
        level = max(statistics.median(points[0][1]) for points in by_name.values())
        axes.plot(ends, 1.6 * level * np.sqrt(ends[0] / ends), "k--", label="slope -1/2")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())  # labels would overlap
        axes.set_xlabel("path evaluations per pixel")
        axes.set_ylabel(measure)
        axes.grid(True, which="both", alpha=0.25)
        axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(out, dpi=DPI)
    pyplot.close(figure)
