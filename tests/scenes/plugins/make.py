#!/usr/bin/env python3
"""Writes this folder's scenes, one per plugin and parameter variant, from the tables beside it.

usage: make.py        (the output is committed; a second run changes nothing)

Every scene is small: an object on a floor under plain light, 16 x 16 pixels, a box filter unless
filters are the subject. So it converges in seconds, and a wrong parameter cannot hide. Mitsuba 3.9
loads every file unchanged; where it cannot, NAME.twin.xml is the same scene in its words.
"""

from pathlib import Path

from assets import write_assets
from variants_geometry import FORMATS, SENSORS, SHAPES
from variants_light import EMITTERS, FILTERS, SPECTRA
from variants_older import OLDER
from variants_surface import BSDFS, TEXTURES
from xml_parts import Variant

HERE = Path(__file__).parent

VARIANTS: list[Variant] = [
    *BSDFS,
    *TEXTURES,
    *EMITTERS,
    *SHAPES,
    *SENSORS,
    *FILTERS,
    *SPECTRA,
    *FORMATS,
    *OLDER,
]


def write_scenes(folder: Path) -> None:
    names = [variant.name for variant in VARIANTS]
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise ValueError(f"two scenes of one name: {sorted(repeated)}")
    for variant in VARIANTS:
        (folder / f"{variant.name}.xml").write_text(variant.document())
        if variant.twin:
            (folder / f"{variant.name}.twin.xml").write_text(variant.twin.document())


def main() -> None:
    write_assets(HERE / "assets")
    write_scenes(HERE)


if __name__ == "__main__":
    main()
