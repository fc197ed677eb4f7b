"""The tables of worker/doc/scene-format.md against the program, row by row.

For every row and form a small scene with the row's example is written and given to the worker,
which must accept what is supported and refuse the rest with file and line.
"""

import re
import shutil
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from farm import ROOT, SCENES, WORKER

DOCUMENT = ROOT / "worker" / "doc" / "scene-format.md"
SOURCES = ROOT / "worker" / "scene_file" / "mitsuba"
ASSETS = SCENES / "plugins" / "assets"

VERSIONS = {"3": "3.0.0", "0.6": "0.6.0"}
# The code's tables of plugins and the document's sections.
CODE_TABLES = {
    "kShapes": "shape",
    "kBsdfs": "bsdf",
    "kTextures": "texture",
    "kSpectra": "spectrum",
    "kEmitters": "emitter",
    "kSensors": "sensor",
    "kFilters": "rfilter",
}


@dataclass(frozen=True)
class Row:
    kind: str
    plugin: str
    parameter: str
    forms: tuple[str, ...]
    example: str
    support: str

    @property
    def accepted(self) -> bool:
        return not self.support.startswith("not supported")


def rows_of_document() -> Iterator[Row]:
    kind = ""
    for line in DOCUMENT.read_text().splitlines():
        if line.startswith("#"):
            kind = line.removeprefix("## ")
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("| ") or len(cells) != 5 or cells[0] in ("plugin", "---"):
            continue
        plugin, parameter, forms, example, support = cells
        assert support.startswith(("supported", "differs: ", "not supported")), line
        assert set(forms.split(", ")) <= set(VERSIONS), line
        yield Row(kind, plugin, parameter, tuple(forms.split(", ")), example.strip("`"), support)


ROWS = list(rows_of_document())
BASES = {(row.kind, row.plugin): row.example for row in reversed(ROWS) if row.parameter == "-"}

NAME = re.compile(r'\bname="([A-Za-z0-9_]+)"')


def camel_case(text: str) -> str:
    """The XML with all its names as 0.6 writes them."""

    def rename(match: re.Match[str]) -> str:
        return f'name="{re.sub("_([a-z])", lambda m: m[1].upper(), match[1])}"'

    return NAME.sub(rename, text)


def without(base: str, example: str) -> str:
    """What a plugin needs, less the parameters that the example gives."""
    for name in NAME.findall(example):
        base = re.sub(rf'<(\w+) name="{name}"[^>]*(/>|>.*?</\1>)', "", base)
    return base


FILM = (
    '<film type="hdrfilm">\n<integer name="width" value="16"/>'
    '<integer name="height" value="16"/></film>'
)
LIGHT = '<emitter type="constant"/>'
SHAPE = '<shape type="disk"/>'
PLACES = {
    "shape": "{}",
    "bsdf": '<shape type="cube">\n{}\n</shape>',
    "texture": '<shape type="cube"><bsdf type="diffuse">\n{}\n</bsdf></shape>',
    "spectrum": '<shape type="cube"><bsdf type="diffuse">\n{}\n</bsdf></shape>',
    "emitter": "{}",
    "sensor": "{}",
    "film": '<sensor type="perspective">\n{}\n</sensor>',
    "rfilter": '<sensor type="perspective"><film type="hdrfilm">\n{}\n</film></sensor>',
    "sampler": '<sensor type="perspective">\n{}\n</sensor>',
    "integrator": "{}",
    "element": "{}",
}


def element(row: Row) -> str:
    """The plugin with the example on a line of its own."""
    if row.kind == "element":
        return row.example
    base = BASES[row.kind, row.plugin]
    rest = "" if row.parameter == "-" else without(base, row.example)
    name = ' name="reflectance"' if row.kind in ("texture", "spectrum") else ""
    return f'<{row.kind}{name} type="{row.plugin}">{rest}\n{row.example}\n</{row.kind}>'


def scene(row: Row, form: str) -> str:
    place = PLACES[row.kind]
    if row.kind == "emitter" and row.plugin in ("area", "directionalarea"):
        place = '<shape type="rectangle">\n{}\n</shape>'
    parts = [place.replace("{}", element(row))]
    if "<sensor" not in parts[0] or row.kind == "shape":
        parts.append(f'<sensor type="perspective">{FILM}</sensor>')
    if row.kind != "emitter" or row.plugin in ("area", "directionalarea"):
        parts.append(LIGHT)
    parts.append(SHAPE)
    text = f'<scene version="{VERSIONS[form]}">\n' + "\n".join(parts) + "\n</scene>\n"
    return text if form == "3" else camel_case(text)


def fault_lines(text: str, row: Row) -> set[int]:
    """Where the fault may be reported: at the parameter, or at the plugin whose it is."""
    lines = text.splitlines()
    example = row.example if row.parameter != "-" or row.kind == "element" else ""
    wanted = [camel_case(example), example] if example else [f'type="{row.plugin}"']
    return {i + 1 for i, line in enumerate(lines) if any(part in line for part in wanted)}


def failure(row: Row, form: str, folder: Path) -> str:
    """What is wrong with the row; nothing if it is true."""
    text = scene(row, form)
    file = folder / f"{row.kind}-{ROWS.index(row)}-{form}.xml"
    file.write_text(text)
    done = subprocess.run(
        [str(WORKER), "files", str(file)], capture_output=True, text=True, timeout=60, check=False
    )
    what = f"{row.kind} {row.plugin}, {row.parameter} ({form}), {row.support}"
    if row.accepted:
        return "" if done.returncode == 0 else f"{what}: {done.stderr.strip()}\n{text}"
    if done.returncode == 0:
        return f"{what}: is accepted\n{text}"
    places = [f"{file.name}:{line}" for line in fault_lines(text, row)]
    named = any(re.search(re.escape(place) + r"\b", done.stderr) for place in places)
    return "" if named else f"{what}: the message is not at {places}: {done.stderr.strip()}\n{text}"


@pytest.mark.parametrize("kind", PLACES)
def test_rows_are_true(kind: str, tmp_path: Path) -> None:
    shutil.copytree(ASSETS, tmp_path / "assets")
    cases = [(row, form) for row in ROWS if row.kind == kind for form in row.forms]
    assert cases, f"no table about {kind}"
    with ThreadPoolExecutor(2) as pool:
        failures = list(pool.map(lambda case: failure(*case, tmp_path), cases))
    wrong = [text for text in failures if text]
    assert not wrong, f"{len(wrong)} of {len(cases)} rows:\n" + "\n".join(wrong)


@dataclass(frozen=True)
class PbrtRow:
    directive: str
    type: str
    example: str
    support: str


def pbrt_rows() -> list[PbrtRow]:
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in DOCUMENT.read_text().splitlines()
        if line.startswith("| ")
    ]
    rows = [row for row in cells if len(row) == 4 and row[0] not in ("directive", "---")]
    return [PbrtRow(d, t, example.strip("`"), support) for d, t, example, support in rows]


OPTIONS = ("Camera", "Film", "PixelFilter", "Sampler", "Integrator", "TransformTimes")


def pbrt_scene(row: PbrtRow) -> str:
    light = 'LightSource "point"' if row.directive != "LightSource" else ""
    example = ["WorldBegin", light, row.example]
    if row.directive in OPTIONS:
        example = [row.example, "WorldBegin", light]
    return "\n".join([*example, 'Shape "sphere"', ""])


def pbrt_failure(row: PbrtRow, file: Path) -> str:
    file.write_text(pbrt_scene(row))
    done = subprocess.run(
        [str(WORKER), "files", str(file)], capture_output=True, text=True, timeout=60, check=False
    )
    what = f"pbrt {row.directive} {row.type}, {row.support}: {done.stderr.strip()}"
    if not row.support.startswith("not supported"):
        return "" if done.returncode == 0 else what
    line = pbrt_scene(row).splitlines().index(row.example) + 1
    refused = done.returncode != 0 and f"{file.name}:{line}" in done.stderr
    return "" if refused else f"{what} (not refused at line {line})"


def test_pbrt_rows_are_true(tmp_path: Path) -> None:
    shutil.copytree(ASSETS, tmp_path / "assets")
    rows = pbrt_rows()
    assert len(rows) > 40
    failures = [pbrt_failure(row, tmp_path / f"{i}.pbrt") for i, row in enumerate(rows)]
    wrong = [text for text in failures if text]
    assert not wrong, f"{len(wrong)} of {len(rows)} rows:\n" + "\n".join(wrong)


def plugins_in_code() -> Iterator[tuple[str, str]]:
    sources = "\n".join(path.read_text() for path in sorted(SOURCES.glob("*.cpp")))
    for table, kind in CODE_TABLES.items():
        match = re.search(rf"constexpr Plugin<[^;]*? {table}\[\] = \{{(.*?)\n\}};", sources, re.S)
        assert match, f"no table {table} in {SOURCES}"
        for name in re.findall(r'\{"(\w+)",', match[1]):
            yield kind, name


def test_every_known_plugin_has_rows() -> None:
    known = set(plugins_in_code())
    assert len(known) > 50, known
    described = {(row.kind, row.plugin) for row in ROWS if row.parameter == "-" and row.accepted}
    assert known <= described, f"not in {DOCUMENT.name}: {sorted(known - described)}"


def test_plugins_have_scenes_of_their_own() -> None:
    """What Mitsuba 3 and the program share is compared with Mitsuba in tests/agreement."""
    texts = [path.read_text() for path in sorted(ASSETS.parent.glob("*.xml"))]
    without_scene = {"merge", "regular", "rawconstant", "deformable"}  # the last is not in Mitsuba
    kinds = ("shape", "bsdf", "texture", "spectrum", "emitter", "sensor", "rfilter")
    for row in ROWS:
        shared = row.kind in kinds and row.parameter == "-" and "3" in row.forms and row.accepted
        if shared and row.plugin not in without_scene:
            assert any(f'type="{row.plugin}"' in text for text in texts), f"no scene: {row}"
