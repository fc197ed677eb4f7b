"""Moving scenes: the film depends on no worker, time is drawn only where it counts, bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from conftest import MakeFarm

from farm import SCENES, Farm, run, zip_folder

MOTION = SCENES / "motion"
CORNELL = SCENES / "cornell-box" / "scene.xml"
SMALL = ["--width", "32", "--height", "32", "--seed", "5"]
BUDGETS = {
    "path": ["--spp", "16"],
    "bdpt": ["--spp", "16"],
    "pssmlt": ["--mutations-per-pixel", "32"],
    "mmlt": ["--mutations-per-pixel", "32"],
}
JOB: dict[str, Any] = {"width": 48, "height": 32, "seed": 3}
JOBS: dict[str, dict[str, Any]] = {
    "path": {**JOB, "integrator": "path", "stop": {"samples_per_pixel": 64}},
    "delayed": {
        **JOB,
        "integrator": "pssmlt",
        "under": "bdpt",
        "delayed_rejection": "on",
        "rolling_shutter": 0.1,
        "stop": {"mutations_per_pixel": 256},
    },
    "mmlt": {
        **JOB,
        "integrator": "mmlt",
        "target": "equalized",
        "direct_apart": "on",
        "shutter_curve": [0, 1, 0.5, 0],
        "exposure": "camera",
        "stop": {"mutations_per_pixel": 256},
    },
}


def film_of(farm: Farm, scene: Path, job: dict[str, Any]) -> str:
    snapshot = farm.wait(farm.submit(scene, **job), timeout=600)
    assert snapshot["state"] == "done", snapshot
    return str(snapshot["film_sha256"])


def test_same_film_with_1_and_2_workers(make_farm: MakeFarm) -> None:
    films: dict[int, list[str]] = {}
    for count in (1, 2):
        farm = make_farm(local_workers=count)
        films[count] = [film_of(farm, MOTION / "car.xml", job) for job in JOBS.values()]
        farm.close()
    assert films[1] == films[2]


def test_frames_of_a_sequence_are_jobs_with_their_shutters(farm: Farm) -> None:
    """Frames 1 and 2 at 8 per second: the ball turns on; each is what a job alone makes of it."""
    ball = MOTION / "ball.xml"
    job = {**JOBS["path"], "stop": {"samples_per_pixel": 8}}
    digest = farm.upload(zip_folder(MOTION)).json()["digest"]
    frames = {"start": 1, "end": 2, "fps": 8, "shutter_angle": 90}
    document = {"job": {"scene": digest, "entry": ball.name, **job}, "frames": frames}
    sequence = farm.post("/v1/sequences", document).json()
    films = [farm.wait(frame["job"])["film_sha256"] for frame in sequence["frames"]]
    assert len(set(films)) == 2
    for number, film in zip((1, 2), films, strict=True):
        shutter = {"shutter_open": (number - 0.125) / 8, "shutter_close": (number + 0.125) / 8}
        assert film_of(farm, ball, {**job, **shutter}) == film


def render(folder: Path, scene: Path, integrator: str, *flags: str) -> dict[str, Any]:
    """Renders a small image and returns the statistics."""
    stats = folder / "stats.json"
    done = run(
        *("render", scene, "-o", folder / "out.exr", "--stats", stats, *SMALL),
        *("--integrator", integrator, *BUDGETS[integrator], *flags),
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(stats.read_text()))


def time_feature(stats: dict[str, Any]) -> tuple[str, str]:
    """Whether samples have a time, and the evidence."""
    feature = next(f for f in stats["plan"]["features"] if f["name"] == "time")
    return feature["state"], feature["evidence"]


def opens(at: float, until: float) -> list[str]:
    return [f"--shutter-open={at}", f"--shutter-close={until}"]


@pytest.mark.parametrize("integrator", BUDGETS)
def test_a_static_scene_knows_no_shutter(integrator: str, tmp_path: Path) -> None:
    plain = render(tmp_path, CORNELL, integrator)
    wide = render(tmp_path, CORNELL, integrator, *opens(-3, 7), "--rolling-shutter=2")
    assert wide["film_sha256"] == plain["film_sha256"]
    assert time_feature(wide)[0] == "skipped"


@pytest.mark.parametrize("integrator", BUDGETS)
def test_time_is_no_coordinate_while_nothing_moves(integrator: str, tmp_path: Path) -> None:
    """After the last key the ball holds: any shutter is an instant's."""
    ball = MOTION / "ball.xml"
    instant = render(tmp_path, ball, integrator, *opens(2, 2))
    assert "instant" in time_feature(instant)[1]
    held = render(tmp_path, ball, integrator, *opens(2, 9))
    assert time_feature(held)[0] == "skipped"
    assert held["film_sha256"] == instant["film_sha256"]
    moving = render(tmp_path, ball, integrator, *opens(1.9, 9))
    assert time_feature(moving)[0] == "used"
    assert moving["film_sha256"] != instant["film_sha256"]


def test_instants_differ(tmp_path: Path) -> None:
    films = {
        render(tmp_path, MOTION / "ball.xml", "path", *opens(t, t))["film_sha256"]
        for t in (0, 0.25, 0.4)
    }
    assert len(films) == 3


BAD_SHUTTERS = {
    "shutter_close": ["--shutter-open=0.5", "--shutter-close=0.25"],
    "shutter_open": ["--shutter-open=9"],
    "shutter_curve": ["--shutter-curve", "0,0,0"],
    "shutter_ramp_open": ["--shutter-curve", "trapezoid", "--shutter-ramp-open=-0.5"],
    "shutter_ramp_close": [
        *("--shutter-curve", "trapezoid"),
        *("--shutter-ramp-open=0.6", "--shutter-ramp-close=0.6"),
    ],
    "exposure": [*opens(0.5, 0.5), "--exposure", "camera"],
}


@pytest.mark.parametrize("field", BAD_SHUTTERS)
def test_bad_shutters_are_refused(field: str, tmp_path: Path) -> None:
    out = tmp_path / "out.exr"
    done = run(
        *("render", MOTION / "ball.xml", "-o", out, "--integrator", "path", "--spp", "1"),
        *BAD_SHUTTERS[field],
    )
    assert done.returncode != 0
    assert field in done.stderr.replace("-", "_"), done.stderr
    assert not out.exists()


SENSOR = """<scene version="3.0.0">
<sensor type="perspective"><float name="shutter_close" value="1"/>
  <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
</sensor>
<emitter type="constant"/>
"""


def ply(corners: int, faces: list[str]) -> str:
    header = f"ply\nformat ascii 1.0\nelement vertex {corners}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{i % 2} {i // 2} 3" for i in range(corners)]
    return header + "\n".join([*rows, *faces]) + "\n"


MESHES = {
    "a.ply": ply(4, ["3 0 1 2", "3 1 3 2"]),
    "more.ply": ply(5, ["3 0 1 2", "3 1 3 2"]),
    "other.ply": ply(4, ["3 0 1 2", "3 1 2 3"]),
    "fewer.ply": ply(4, ["3 0 1 2"]),
}


def deformable(files: str, times: str) -> str:
    return (
        f'<shape type="deformable"><string name="filename" value="{files}"/>'
        f'<string name="times" value="{times}"/></shape>'
    )


def animated(*times: str) -> str:
    keys = "".join(
        f'<transform time="{t}"><translate x="{i}"/></transform>' for i, t in enumerate(times)
    )
    return f'<shape type="sphere"><animation name="to_world">{keys}</animation></shape>'


# A shape of one line, and a word of the message that it must bring.
BAD_SHAPES = {
    "more-vertices": (deformable("a.ply, more.ply", "0, 1"), "more.ply"),
    "other-faces": (deformable("a.ply, other.ply", "0, 1"), "other.ply"),
    "fewer-faces": (deformable("a.ply, fewer.ply", "0, 1"), "fewer.ply"),
    "missing-key": (deformable("a.ply, gone.ply", "0, 1"), "gone.ply"),
    "too-few-times": (deformable("a.ply, a.ply", "0"), "times"),
    "same-times-of-meshes": (deformable("a.ply, a.ply", "1, 1"), "time"),
    "no-keys": (animated(), "animation"),
    "same-times": (animated("0", "0"), "time"),
    "time-is-no-number": (animated("0", "soon"), "time"),
    "unknown-path": (
        animated("0", "1").replace("<animation", '<animation interpolation="wobbly"'),
        "wobbly",
    ),
    "flat": (
        animated("0", "1").replace('<translate x="1"/>', '<scale x="0"/>'),
        "flatten",
    ),
    "mirrored-on-the-way": (
        animated("0", "1").replace('<translate x="1"/>', '<scale x="-1"/>'),
        "mirrored",
    ),
    "far-control-point": (
        animated("0", "1")
        .replace("<animation", '<animation interpolation="bezier"')
        .replace('time="0"', 'time="0" out="1e200, 0, 0"'),
        "reaches beyond",
    ),
}


@pytest.mark.parametrize("name", BAD_SHAPES)
def test_bad_motion_is_told_with_its_place(name: str, tmp_path: Path) -> None:
    shape, word = BAD_SHAPES[name]
    for file, text in MESHES.items():
        (tmp_path / file).write_text(text)
    scene = tmp_path / f"{name}.xml"
    scene.write_text(f"{SENSOR}{shape}\n</scene>\n")
    line = SENSOR.count("\n") + 1
    out = tmp_path / "out.exr"
    done = run("render", scene, "-o", out, "--integrator", "path", "--spp", "1")
    assert done.returncode != 0
    assert f"{scene.name}:{line}" in done.stderr, done.stderr
    assert word in done.stderr, done.stderr
    assert not out.exists()


LIT = '<emitter type="area"><rgb name="radiance" value="1"/></emitter>'
# One-sided lights: what is seen of them tells their sides.
ONE_SIDED = {
    "sphere": f'<shape type="sphere">POSE{LIT}</shape>',
    "disk": f'<shape type="disk">POSE{LIT}</shape>',
    "rectangle": f'<shape type="rectangle">POSE{LIT}</shape>',
    "triangles": f'<shape type="ply"><string name="filename" value="a.ply"/>POSE{LIT}</shape>',
    "faces": '<shape type="ply"><string name="filename" value="a.ply"/>'
    f'<boolean name="face_normals" value="true"/>POSE{LIT}</shape>',
    "deformable": deformable("a.ply, a.ply", "0, 1").replace("</shape>", f"POSE{LIT}</shape>"),
}


def brightness(scene: Path) -> float:
    """Mean of the image of a scene, over a shutter of one second."""
    out = scene.with_suffix(".exr")
    done = run(
        *("render", scene, "-o", out, "--integrator", "path", "--spp", "64", "--seed", "1"),
        *opens(0, 1),
    )
    assert done.returncode == 0, done.stderr
    with OpenEXR.File(str(out), separate_channels=True) as image:
        return float(np.mean(image.channels()["G"].pixels))


@pytest.mark.parametrize("mirror", ["1", "-1"])
@pytest.mark.parametrize("turn", [0, 180])
@pytest.mark.parametrize("name", ONE_SIDED)
def test_mirrored_poses_turn_what_moves_as_what_stands(
    name: str, turn: int, mirror: str, tmp_path: Path
) -> None:
    for file, text in MESHES.items():
        (tmp_path / file).write_text(text)
    steps = f'<scale x="{mirror}"/><rotate y="1" angle="{turn}"/><translate z="SHIFT"/>'
    far = 4 if name not in ("triangles", "faces", "deformable") else 7 * (turn > 0)
    still, moves = (steps.replace("SHIFT", str(far + shift)) for shift in (0, 1e-5))
    poses = {
        "still": f'<transform name="to_world">{still}</transform>',
        "moving": f'<animation name="to_world"><transform time="0">{still}</transform>'
        f'<transform time="1">{moves}</transform></animation>',
    }
    seen = {}
    for kind, pose in poses.items():
        scene = tmp_path / f"{kind}.xml"
        content = SENSOR.replace('<emitter type="constant"/>\n', "")
        scene.write_text(content + ONE_SIDED[name].replace("POSE", pose) + "\n</scene>\n")
        seen[kind] = brightness(scene)
    assert seen["moving"] == pytest.approx(seen["still"], rel=1e-3, abs=1e-6)


def test_meshes_without_extent_may_move(tmp_path: Path) -> None:
    """A mesh that is one point, and one scaled to almost nothing."""
    flat = ply(3, ["3 0 1 2"]).rsplit("end_header", 1)[0] + "end_header\n" + "1 1 3\n" * 3
    (tmp_path / "point.ply").write_text(flat + "3 0 1 2\n")
    (tmp_path / "a.ply").write_text(MESHES["a.ply"])
    scene = tmp_path / "point.xml"
    shapes = [
        animated("0", "1").replace(
            'type="sphere">', f'type="ply"><string name="filename" value="{file}"/>'
        )
        for file in ("point.ply", "a.ply")
    ]
    shapes[1] = shapes[1].replace("<translate", '<scale value="1e-20"/><translate')
    scene.write_text(SENSOR + "".join(shapes) + "\n</scene>\n")
    for integrator in BUDGETS:
        stats = render(tmp_path, scene, integrator, *opens(0, 1))
        assert stats["film_sha256"]
