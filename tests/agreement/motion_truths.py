"""Closed forms of the motion tests' images: (SIDE, SIDE, 3), exact to 1e-6 of what they state."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SIDE = 32
# Points of quadrature: in each pixel and over the time that the shutter is open.
PER_PIXEL = 64
INSTANTS = 20_001


@dataclass(frozen=True)
class Shutter:
    """When it is open (seconds), how far over that time (0 to 1), and what becomes of the light."""

    opens: float = 0.0
    closes: float = 1.0
    efficiency: Callable[[np.ndarray], np.ndarray] = np.ones_like
    camera: bool = False
    # Seconds by which the last row lags the first.
    roll: float = 0.0


def row_lags(shutter: Shutter, strips: int) -> np.ndarray:
    """In the middle of each of so many strips of each row of pixels: the lag grows from the middle
    of the first row to that of the last."""
    down = (np.arange(SIDE * strips) + 0.5) / strips
    return shutter.roll * np.clip((down - 0.5) / (SIDE - 1), 0.0, 1.0)


def wiper(shutter: Shutter) -> np.ndarray:
    """At the share s of the width the wall is seen from the time s on."""
    relative = np.linspace(0.0, 1.0, INSTANTS)
    efficiency = shutter.efficiency(relative)
    length = shutter.closes - shutter.opens
    steps = 0.5 * (efficiency[1:] + efficiency[:-1]) * length / (INSTANTS - 1)
    so_far = np.concatenate([[0.0], np.cumsum(steps)])
    seen_from = ((np.arange(SIDE * PER_PIXEL) + 0.5) / (SIDE * PER_PIXEL)).reshape(SIDE, PER_PIXEL)
    rows = []
    for lag in row_lags(shutter, PER_PIXEL) if shutter.roll else [0.0]:
        since = np.clip((seen_from - shutter.opens - lag) / length, 0.0, 1.0)
        light = so_far[-1] - np.interp(since, relative, so_far)
        rows.append(light.mean(axis=1) / (1.0 if shutter.camera else so_far[-1]))
    lines = np.broadcast_to(np.stack(rows), (SIDE * PER_PIXEL, SIDE))
    image = lines.reshape(SIDE, PER_PIXEL, SIDE).mean(axis=1)
    return image[:, :, None] * np.array([2.0, 1.0, 0.5])


def corner_angle(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Solid angle of the rectangle from (0, 0) to (x, y), seen from height z above (0, 0)."""
    return np.arctan(x * y / (z * np.sqrt(x * x + y * y + z * z)))


@dataclass(frozen=True)
class Flight:
    """Of a ball of light, in the image's coordinates: position and radius at the times 0 and 1."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: tuple[float, float]


LAMP = Flight((-1.2, -0.4, 1.3), (1.0, 0.6, 1.9), (0.1, 0.2))
TOGETHER = Flight((-0.4, 0.3, 1.5), (-0.4, 0.3, 1.5), (0.15, 0.15))


def lamp(flight: Flight, shutter: Shutter) -> np.ndarray:
    """The mean over the time of radiance r^2 times the solid angle of a strip of a pixel over its
    area, reflected. The shutter is a box that is open while the lamp moves."""
    nodes, weights = np.polynomial.legendre.leggauss(32)
    strips = 8
    x_edges = np.linspace(-1.0, 1.0, SIDE + 1)
    y_edges = np.linspace(1.0, -1.0, SIDE * strips + 1)
    area = (x_edges[1] - x_edges[0]) * (y_edges[0] - y_edges[1])
    start, end = np.array(flight.start), np.array(flight.end)
    rows = []
    for top, bottom, lag in zip(y_edges, y_edges[1:], row_lags(shutter, strips), strict=False):
        middle = 0.5 * (shutter.opens + shutter.closes) + lag
        time = middle + 0.5 * (shutter.closes - shutter.opens) * nodes
        x, y, z = (start + time[:, None] * (end - start)).T[:, :, None]
        # [time, column]
        angle = np.diff(corner_angle(x_edges - x, top - y, z), axis=1)
        angle -= np.diff(corner_angle(x_edges - x, bottom - y, z), axis=1)
        radius = flight.radius[0] + (flight.radius[1] - flight.radius[0]) * time
        rows.append(0.5 * weights * 20.0 * radius**2 @ angle / area)
    image = np.stack(rows).reshape(SIDE, strips, SIDE).mean(axis=1)
    return image[:, :, None] * np.array([0.5, 0.25, 0.8])


def spin() -> np.ndarray:
    """The disk of radius 0.75 on a film from -1 to 1."""
    fine = (np.arange(SIDE * PER_PIXEL) + 0.5) * 2.0 / (SIDE * PER_PIXEL) - 1.0
    half_chord = np.sqrt(np.maximum(0.75**2 - fine**2, 0.0))
    edges = np.linspace(-1.0, 1.0, SIDE + 1)
    low, high = edges[:-1, None], edges[1:, None]
    covered = np.clip(np.minimum(high, half_chord) - np.maximum(low, -half_chord), 0.0, None)
    share = covered.reshape(SIDE, SIDE, PER_PIXEL).mean(axis=2) * SIDE / 2.0
    return share[:, :, None] * np.array([0.5, 1.0, 2.0])


def furnace() -> np.ndarray:
    return np.broadcast_to([0.5, 1.0, 2.0], (SIDE, SIDE, 3)).copy()
