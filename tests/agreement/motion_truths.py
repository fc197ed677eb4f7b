"""Closed forms of the motion tests' images: (SIDE, SIDE, 3), exact to 1e-6 of what they state."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cases import TILE

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


def wiper(shutter: Shutter) -> np.ndarray:
    """At the share s of the width the wall is seen from the time s on."""
    relative = np.linspace(0.0, 1.0, INSTANTS)
    efficiency = shutter.efficiency(relative)
    length = shutter.closes - shutter.opens
    steps = 0.5 * (efficiency[1:] + efficiency[:-1]) * length / (INSTANTS - 1)
    so_far = np.concatenate([[0.0], np.cumsum(steps)])
    seen_from = ((np.arange(SIDE * PER_PIXEL) + 0.5) / (SIDE * PER_PIXEL)).reshape(SIDE, PER_PIXEL)
    lags = shutter.roll * np.arange(SIDE) / (SIDE - 1)
    rows = []
    for lag in lags:
        since = np.clip((seen_from - shutter.opens - lag) / length, 0.0, 1.0)
        light = so_far[-1] - np.interp(since, relative, so_far)
        rows.append(light.mean(axis=1) / (1.0 if shutter.camera else so_far[-1]))
    return np.stack(rows)[:, :, None] * np.array([2.0, 1.0, 0.5])


def corner_angle(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Solid angle of the rectangle from (0, 0) to (x, y), seen from height z above (0, 0)."""
    return np.arctan(x * y / (z * np.sqrt(x * x + y * y + z * z)))


def lamp() -> np.ndarray:
    """The mean over the flight of radiance r^2 times a tile's solid angle over its area, reflected;
    every pixel of a tile has its tile's mean."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    time = 0.5 * (nodes + 1)
    position = np.array([-1.2, -0.4, 1.3]) + time[:, None] * (
        np.array([1.0, 0.6, 1.9]) - np.array([-1.2, -0.4, 1.3])
    )
    radius = 0.1 + 0.1 * time
    edges = np.linspace(-1.0, 1.0, SIDE // TILE + 1)
    x, y, z = position.T
    # [time, row, column]; the first row is the one with the largest y.
    corner = corner_angle(
        edges[None, None, :] - x[:, None, None],
        edges[None, ::-1, None] - y[:, None, None],
        z[:, None, None],
    )
    angle = -np.diff(np.diff(corner, axis=1), axis=2)
    area = (edges[1] - edges[0]) ** 2
    flux = np.einsum("t,trc->rc", 0.5 * weights * 20.0 * radius**2, angle) / area
    tiles = flux[:, :, None] * np.array([0.5, 0.25, 0.8])
    return np.kron(tiles, np.ones((TILE, TILE, 1)))


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
