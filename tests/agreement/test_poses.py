"""The poses that the motion tests compare with, against poses worked out by hand."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from cases import SCENES
from poses import pose, read_ply, stratified_times, write_posed

QUARTER = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
HALF = [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]


def animation(*keys: str, interpolation: str = "linear") -> ElementTree.Element:
    text = "".join(keys)
    return ElementTree.fromstring(f'<animation interpolation="{interpolation}">{text}</animation>')


def key(time: float, steps: str, more: str = "") -> str:
    return f'<transform time="{time}" {more}>{steps}</transform>'


def turns(*angles: float, times: tuple[float, ...] = (0, 1)) -> ElementTree.Element:
    keys = zip(times, angles, strict=True)
    return animation(*(key(time, f'<rotate z="1" angle="{angle}"/>') for time, angle in keys))


@pytest.mark.parametrize(
    ("degrees", "time", "expected"),
    [(720, 0.125, QUARTER), (720, 0.25, HALF), (-540, 0.5, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])],
)
def test_told_turns_go_all_the_way(degrees: float, time: float, expected: list) -> None:
    assert np.allclose(pose(turns(0, degrees), time)[:3, :3], expected)


def test_other_steps_take_the_shorter_arc() -> None:
    back = animation(
        key(0, '<rotate z="1" angle="0"/>'),
        key(1, '<rotate z="1" angle="100"/><rotate z="1" angle="200"/>'),
    )
    angle = np.radians(-30)
    assert np.allclose(pose(back, 0.5)[0, :2], [np.cos(angle), -np.sin(angle)])


def test_later_turns_carry_the_axis_along() -> None:
    steps = '<rotate y="1" angle="{}"/><rotate x="1" angle="90"/>'
    moving = animation(key(0, steps.format(0)), key(1, steps.format(360)))
    # A quarter about y takes x to -z, and a quarter about x that to y.
    assert np.allclose(pose(moving, 0.25)[:3, 0], [0, 1, 0])


def test_stretch_and_place_go_linearly_and_hold() -> None:
    moving = animation(
        key(1, '<scale x="1" y="2" z="3"/>'), key(2, '<scale x="3" y="2" z="1"/><translate x="4"/>')
    )
    assert np.allclose(pose(moving, 1.25), np.diag([1.5, 2, 2.5, 1]) + shift(1))
    assert np.allclose(pose(moving, 0), np.diag([1, 2, 3, 1]))
    assert np.allclose(pose(moving, 9), np.diag([3, 2, 1, 1]) + shift(4))


def shift(x: float) -> np.ndarray:
    matrix = np.zeros((4, 4))
    matrix[0, 3] = x
    return matrix


def test_curves() -> None:
    points = [0.0, 1.0, 5.0, 2.0]
    keys = [key(i, f'<translate x="{x}"/>') for i, x in enumerate(points)]
    middle = pose(animation(*keys, interpolation="catmullrom"), 1.5)[0, 3]
    assert middle == pytest.approx((-0 + 9 * 1 + 9 * 5 - 2) / 16)
    # The velocity at the first key is that of the straight way, 1, and at the second 2.5.
    first = pose(animation(*keys, interpolation="catmullrom"), 0.5)[0, 3]
    assert first == pytest.approx(0.5 * (0 + 1) + (1 - 2.5) / 8)
    bezier = animation(
        key(0, '<translate x="1"/>', 'out="3, 0, 0"'),
        key(2, '<translate x="2"/>', 'in="7, 0, 0"'),
        interpolation="bezier",
    )
    assert pose(bezier, 1)[0, 3] == pytest.approx((1 + 3 * 3 + 3 * 7 + 2) / 8)


def test_a_parabola_is_a_catmull_rom_curve_through_uneven_keys() -> None:
    """Inside, where velocities are those of parabolas; cubics give quadratics back exactly."""
    times = [0.0, 1.0, 1.5, 3.0, 3.2]
    keys = [key(t, f'<translate x="{2 - t + 3 * t * t}"/>') for t in times]
    moving = animation(*keys, interpolation="catmullrom")
    for t in (1.1, 1.4, 2.0, 2.9):
        assert pose(moving, t)[0, 3] == pytest.approx(2 - t + 3 * t * t)


def test_a_deforming_mesh_is_half_way_between_its_keys(tmp_path: Path) -> None:
    cloth = SCENES / "motion" / "cloth.xml"
    posed = ElementTree.parse(write_posed(cloth, 0.375, tmp_path)).getroot()
    shape = posed.find("shape[@type='ply']")
    assert shape.find("string[@name='times']") is None
    name = shape.find("string[@name='filename']").attrib["value"]
    ours = read_ply(tmp_path / name)[1]
    a, b = (read_ply(cloth.parent / f"cloth{i}.ply")[1] for i in (1, 2))
    assert np.allclose(ours[:, :3], (a + b)[:, :3] / 2, atol=1e-6)
    assert np.allclose(np.linalg.norm(ours[:, 3:], axis=1), 1)
    assert posed.find(".//animation") is None


def test_times_are_stratified() -> None:
    times = stratified_times(2.0, 4.0, 8, np.random.default_rng(1))
    assert np.array_equal(np.floor((times - 2) * 4), np.arange(8))
