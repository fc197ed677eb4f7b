"""What only Mitsuba 0.6 has; the twins say the same in Mitsuba 3's words.

"phong" and "difftrans" of the twins are plugins of our own: agreement/mitsuba_phong.py and
mitsuba_difftrans.py.
"""

from dataclasses import replace

from xml_parts import (
    Variant,
    bitmap,
    boolean,
    bsdf,
    number,
    on_panel,
    on_sphere,
    rgb,
    shape,
    string,
)

RED = bsdf("diffuse", rgb("reflectance", "0.7, 0.2, 0.1"))
BLUE = bsdf("diffuse", rgb("reflectance", "0.1, 0.2, 0.6"))
GOLD = bsdf("roughconductor", string("material", "Au"), number("alpha", 0.3))
BLACK = bsdf("diffuse", rgb("reflectance", "0, 0, 0"))
COLOURS = bitmap("reflectance", "colours.png")


def with_twin(older: Variant, twin: Variant) -> Variant:
    stated = replace(twin, purpose=f"older plugins: the twin of {older.name}")
    return replace(older, version="0.6.0", twin=stated)


def material(name: str, what: str, older: str, twin: str) -> Variant:
    purpose = f"older plugins: {what}"
    return with_twin(on_sphere(name, purpose, older), on_sphere(name, purpose, twin))


def sheet(name: str, what: str, older: str, twin: str) -> Variant:
    purpose = f"older plugins: {what}"
    return with_twin(on_panel(name, purpose, older), on_panel(name, purpose, twin))


def phong(diffuse: str, specular: str, exponent: float, names: tuple[str, str]) -> str:
    return bsdf(
        "phong",
        diffuse,
        rgb(names[1], specular),
        number("exponent", exponent),
    )


def blend(weight: float, first: str, second: str) -> str:
    return bsdf("blendbsdf", number("weight", weight), first, second)


def patch(name: str, what: str, *parameters: str) -> Variant:
    parts = (shape("ply", string("filename", "assets/patch.ply"), *parameters),)
    return Variant(name, f"older plugins: {what}", parts)


OLD_NAMES = ("diffuseReflectance", "specularReflectance")
NEW_NAMES = ("diffuse_reflectance", "specular_reflectance")

OLDER = [
    material(
        "bsdf-phong",
        "phong: both colours and the exponent",
        phong(rgb(OLD_NAMES[0], "0.4, 0.3, 0.2"), "0.2, 0.4, 0.5", 25, OLD_NAMES),
        phong(rgb(NEW_NAMES[0], "0.4, 0.3, 0.2"), "0.2, 0.4, 0.5", 25, NEW_NAMES),
    ),
    sheet(
        "bsdf-phong-textured",
        "phong: a texture under a gloss",
        phong(bitmap(OLD_NAMES[0], "colours.png"), "0.05, 0.05, 0.05", 8, OLD_NAMES),
        phong(bitmap(NEW_NAMES[0], "colours.png"), "0.05, 0.05, 0.05", 8, NEW_NAMES),
    ),
    sheet(
        "bsdf-difftrans",
        "difftrans: transmittance",
        bsdf("difftrans", rgb("transmittance", "0.3, 0.6, 0.8")),
        bsdf("difftrans", rgb("transmittance", "0.3, 0.6, 0.8")),
    ),
    sheet(
        "bsdf-difftrans-textured",
        "difftrans: transmittance from a texture",
        bsdf("difftrans", bitmap("transmittance", "colours.png")),
        bsdf("difftrans", bitmap("transmittance", "colours.png")),
    ),
    material(
        "bsdf-mixture",
        "mixturebsdf: two of three parts, the rest is black",
        bsdf("mixturebsdf", string("weights", "0.3, 0.5"), RED, GOLD),
        blend(0.2, blend(0.625, RED, GOLD), BLACK),
    ),
    material(
        "bsdf-mixture-three",
        "mixturebsdf: three parts",
        bsdf("mixturebsdf", string("weights", "0.3, 0.5, 0.2"), RED, GOLD, BLUE),
        blend(0.2, blend(0.625, RED, GOLD), BLUE),
    ),
    material(
        "bsdf-roughdiffuse",
        "roughdiffuse, which is rendered as diffuse",
        bsdf("roughdiffuse", rgb("reflectance", "0.7, 0.2, 0.1"), number("alpha", 0.4)),
        RED,
    ),
    # A diffuse surface is linear in its reflectance.
    sheet(
        "texture-scale-0-6",
        "scale: a texture times a number",
        bsdf(
            "diffuse",
            '<texture name="reflectance" type="scale">',
            number("scale", 0.4) + bitmap("", "colours.png").replace(' name=""', "") + "</texture>",
        ),
        blend(0.4, BLACK, bsdf("diffuse", COLOURS)),
    ),
    with_twin(
        patch(
            "texture-vertexcolors-0-6",
            "vertexcolors",
            boolean("srgb", False),
            bsdf("diffuse", '<texture name="reflectance" type="vertexcolors"/>'),
        ),
        patch(
            "texture-vertexcolors-0-6",
            "",
            bsdf(
                "diffuse",
                '<texture name="reflectance" type="mesh_attribute">'
                f"{string('name', 'vertex_color')}</texture>",
            ),
        ),
    ),
]
