"""Bad input: a message that names file and line, a clear refusal, and a service that lives on."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from farm import SCENES, Answer, Farm, run, zip_files

SENSOR = """<sensor type="perspective">
  <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
</sensor>"""
LIGHT = '<emitter type="constant"/>'
CUBE = '<shape type="cube"/>'


@dataclass(frozen=True)
class BadScene:
    name: str
    text: str
    # Line of the fault; None where no line is to blame.
    line: int | None
    # A word that the message must have.
    word: str


def scene(*parts: str) -> str:
    return '<scene version="3.0.0">\n' + "\n".join(parts) + "\n</scene>\n"


BAD_SCENES = [
    BadScene("malformed", scene(SENSOR, '<shape type="cube">', LIGHT), 7, "XML"),
    BadScene("unknown-plugin", scene(SENSOR, LIGHT, '<shape type="teapot"/>'), 6, "teapot"),
    BadScene(
        "unknown-parameter",
        scene(SENSOR, LIGHT, '<shape type="sphere"><float name="radios" value="1"/></shape>'),
        6,
        "radios",
    ),
    BadScene(
        "wrong-type",
        scene(SENSOR, LIGHT, '<shape type="sphere"><string name="radius" value="big"/></shape>'),
        6,
        "radius",
    ),
    BadScene(
        "missing-mesh",
        scene(
            SENSOR,
            LIGHT,
            '<shape type="obj"><string name="filename" value="gone.obj"/></shape>',
        ),
        6,
        "gone.obj",
    ),
    BadScene("empty", scene(), None, "sensor"),
    BadScene("no-light", scene(SENSOR, CUBE), None, "light"),
]


def names_the_place(bad: BadScene, message: str, file: str) -> None:
    place = file if bad.line is None else f"{file}:{bad.line}"
    assert place in message, message
    assert bad.word in message, message


@pytest.mark.parametrize("bad", BAD_SCENES, ids=lambda bad: bad.name)
def test_command_line_refuses(bad: BadScene, tmp_path: Path) -> None:
    file = tmp_path / f"{bad.name}.xml"
    file.write_text(bad.text)
    done = run("render", file, "-o", tmp_path / "out.exr", "--integrator", "path", "--spp", "4")
    assert done.returncode != 0
    names_the_place(bad, done.stderr, file.name)
    assert not (tmp_path / "out.exr").exists()


def test_command_line_refuses_a_missing_scene(tmp_path: Path) -> None:
    done = run("render", tmp_path / "nowhere.xml", "-o", tmp_path / "out.exr")
    assert done.returncode != 0
    assert "nowhere.xml" in done.stderr


def test_command_line_refuses_unknown_flags_and_bad_values(tmp_path: Path) -> None:
    cornell = SCENES / "cornell-box" / "scene.xml"
    for flags in (["--no-such-flag"], ["--spp", "many"], ["--integrator", "magic"]):
        done = run("render", cornell, "-o", tmp_path / "out.exr", *flags)
        assert done.returncode == 2, done.stderr
        assert flags[0].lstrip("-") in done.stderr


def problem(answer: Answer) -> str:
    """The text of a problem document, which every refusal must be (RFC 9457)."""
    assert 400 <= answer.status < 500, (answer.status, answer.body)
    assert answer.media_type == "application/problem+json"
    document = answer.json()
    assert document["status"] == answer.status
    assert document["detail"]
    return answer.body.decode()


def submit_text(farm: Farm, name: str, text: str) -> str:
    """What the service says about a scene: in the answer, or as the error of the failed job."""
    uploaded = farm.upload(zip_files({name: text.encode()}))
    if uploaded.status >= 400:
        return problem(uploaded)
    document = {"scene": uploaded.json()["digest"], "entry": name, "integrator": "path"}
    submitted = farm.post("/v1/jobs", document)
    if submitted.status >= 400:
        return problem(submitted)
    snapshot = farm.wait(submitted.json()["id"], timeout=60)
    assert snapshot["state"] == "failed", snapshot
    return str(snapshot["error"])


def test_service_refuses_bad_scenes_and_finishes_the_others(farm: Farm) -> None:
    other = farm.submit(
        SCENES / "cornell-box" / "scene.xml",
        integrator="pssmlt",
        width=32,
        height=32,
        stop={"mutations_per_pixel": 1024},
    )
    for bad in BAD_SCENES:
        file = f"{bad.name}.xml"
        names_the_place(bad, submit_text(farm, file, bad.text), file)
    assert farm.get("/healthz").status == 200
    assert farm.wait(other)["state"] == "done"


BAD_BUNDLES: dict[str, bytes] = {
    "not-a-zip": b"this is no archive",
    "empty-body": b"",
    "dotdot": zip_files({"scene.xml": b"<scene/>", "../escaped.xml": b"<scene/>"}),
    "dotdot-inside": zip_files({"scene.xml": b"<scene/>", "a/../../escaped.xml": b"<scene/>"}),
    "absolute": zip_files({"scene.xml": b"<scene/>", "/tmp/escaped.xml": b"<scene/>"}),
    "backslash": zip_files({"scene.xml": b"<scene/>", "..\\escaped.xml": b"<scene/>"}),
}


def test_service_refuses_bad_bundles(farm: Farm) -> None:
    for name, bundle in BAD_BUNDLES.items():
        text = problem(farm.upload(bundle))
        if "escaped" in str(bundle):
            assert "escaped.xml" in text, (name, text)
    assert not list(farm.folder.parent.rglob("escaped.xml"))
    assert farm.get("/healthz").status == 200


def test_references_stay_inside_the_bundle(farm: Farm) -> None:
    text = scene(
        SENSOR,
        LIGHT,
        '<shape type="obj"><string name="filename" value="../../../../etc/passwd"/></shape>',
    )
    message = submit_text(farm, "outside.xml", text)
    assert "outside.xml:6" in message, message
    assert "root:" not in message


Change = Callable[[dict[str, Any]], dict[str, Any]]
BAD_REQUESTS: dict[str, Change] = {
    "scene": lambda request: {**request, "scene": "0" * 64},
    "entry": lambda request: {**request, "entry": "other.xml"},
    "integrator": lambda request: {**request, "integrator": "magic"},
    "width": lambda request: {**request, "width": -4},
    "stop": lambda request: {**request, "stop": {"target_error": "small"}},
    "colour": lambda request: {**request, "colour": "blue"},
}


@pytest.mark.parametrize("field", BAD_REQUESTS)
def test_service_names_the_field(farm: Farm, field: str) -> None:
    uploaded = farm.upload(zip_files({"scene.xml": scene(SENSOR, LIGHT).encode()}))
    request = {"scene": uploaded.json()["digest"], "entry": "scene.xml"}
    text = problem(farm.post("/v1/jobs", BAD_REQUESTS[field](request)))
    assert field in text


def test_unknown_jobs_are_problems(farm: Farm) -> None:
    for path in ("", "/image.exr", "/image.png", "/convergence", "/events", "/plan"):
        assert farm.get(f"/v1/jobs/none{path}").status == 404
        problem(farm.get(f"/v1/jobs/none{path}"))
