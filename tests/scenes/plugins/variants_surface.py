"""Materials and textures."""

from xml_parts import (
    FLOOR,
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
    texture,
    to_world,
)

RED = bsdf("diffuse", rgb("reflectance", "0.7, 0.2, 0.1"))
BLUE = bsdf("diffuse", rgb("reflectance", "0.1, 0.2, 0.6"))
ROUGH_GOLD = bsdf("roughconductor", string("material", "Au"), number("alpha", 0.3))
COLOURS = bitmap("reflectance", "colours.png")


def principled(name: str, what: str, *parameters: str) -> Variant:
    material = bsdf("principled", rgb("base_color", "0.7, 0.4, 0.2"), *parameters)
    return on_sphere(f"bsdf-principled-{name}", f"principled: {what}", material)


def principled_thin(name: str, what: str, *parameters: str) -> Variant:
    material = bsdf("principledthin", rgb("base_color", "0.7, 0.4, 0.2"), *parameters)
    return on_panel(f"bsdf-principledthin-{name}", f"principledthin: {what}", material)


def rough_conductor(name: str, what: str, *parameters: str) -> Variant:
    material = bsdf("roughconductor", *parameters)
    return on_sphere(f"bsdf-roughconductor-{name}", f"roughconductor: {what}", material)


CONDUCTORS = [
    on_sphere(
        "bsdf-conductor-default", "conductor without parameters: a mirror", bsdf("conductor")
    ),
    *(
        on_sphere(
            f"bsdf-conductor-{metal.lower()}",
            f"conductor: the named material {metal}",
            bsdf("conductor", string("material", metal)),
        )
        for metal in ("Au", "Cu", "Al", "none")
    ),
    on_sphere(
        "bsdf-conductor-eta-k",
        "conductor: eta, k and specular_reflectance as colours",
        bsdf(
            "conductor",
            rgb("eta", "0.2, 0.9, 1.1"),
            rgb("k", "3.9, 2.4, 2.2"),
            rgb("specular_reflectance", "0.9, 0.8, 0.7"),
        ),
    ),
    rough_conductor("default", "default alpha and distribution (beckmann, 0.1)"),
    *(
        rough_conductor(
            f"{distribution}-{str(alpha).replace('.', '')}",
            f"{distribution}, alpha {alpha}",
            string("distribution", distribution),
            number("alpha", alpha),
            string("material", "Cu"),
        )
        for distribution in ("ggx", "beckmann")
        for alpha in (0.05, 0.2, 0.5)
    ),
    *(
        rough_conductor(
            f"{distribution}-anisotropic",
            f"{distribution} with alpha_u and alpha_v",
            string("distribution", distribution),
            number("alpha_u", 0.1),
            number("alpha_v", 0.4),
            string("material", "Al"),
        )
        for distribution in ("ggx", "beckmann")
    ),
    on_panel(
        "bsdf-roughconductor-textured-alpha",
        "roughconductor: alpha and specular_reflectance from textures",
        bsdf(
            "roughconductor",
            string("distribution", "ggx"),
            bitmap("alpha", "grey.png", raw=True),
            bitmap("specular_reflectance", "colours.png"),
        ),
    ),
]

DIELECTRICS = [
    on_sphere("bsdf-dielectric-default", "dielectric without parameters", bsdf("dielectric")),
    on_sphere(
        "bsdf-dielectric-names",
        "dielectric: int_ior and ext_ior as names",
        bsdf("dielectric", string("int_ior", "diamond"), string("ext_ior", "water")),
    ),
    on_sphere(
        "bsdf-dielectric-tinted",
        "dielectric: numeric index, specular_reflectance and specular_transmittance",
        bsdf(
            "dielectric",
            number("int_ior", 1.5),
            rgb("specular_reflectance", "0.9, 0.5, 0.2"),
            rgb("specular_transmittance", "0.3, 0.6, 0.9"),
        ),
    ),
    on_sphere(
        "bsdf-dielectric-inverted",
        "dielectric: the denser side outside, so with total reflection",
        bsdf("dielectric", number("int_ior", 1.0), number("ext_ior", 1.4)),
    ),
    on_sphere("bsdf-thindielectric", "thindielectric", bsdf("thindielectric")),
    on_panel(
        "bsdf-thindielectric-tinted",
        "thindielectric: int_ior and both tints",
        bsdf(
            "thindielectric",
            number("int_ior", 2.2),
            rgb("specular_reflectance", "0.9, 0.5, 0.2"),
            rgb("specular_transmittance", "0.3, 0.6, 0.9"),
        ),
    ),
    *(
        on_sphere(
            f"bsdf-roughdielectric-{distribution}",
            f"roughdielectric: {distribution}, alpha {alpha}",
            bsdf(
                "roughdielectric",
                string("distribution", distribution),
                number("alpha", alpha),
                string("int_ior", "bk7"),
            ),
        )
        for distribution, alpha in (("ggx", 0.3), ("beckmann", 0.15))
    ),
    on_sphere(
        "bsdf-roughdielectric-anisotropic",
        "roughdielectric: alpha_u, alpha_v and both tints",
        bsdf(
            "roughdielectric",
            string("distribution", "ggx"),
            number("alpha_u", 0.1),
            number("alpha_v", 0.5),
            rgb("specular_reflectance", "0.9, 0.5, 0.2"),
            rgb("specular_transmittance", "0.3, 0.6, 0.9"),
        ),
    ),
    on_panel(
        "bsdf-roughdielectric-textured-alpha",
        "roughdielectric: alpha from a texture",
        bsdf("roughdielectric", bitmap("alpha", "grey.png", raw=True)),
    ),
]

PLASTICS = [
    on_sphere("bsdf-plastic-default", "plastic without parameters", bsdf("plastic")),
    on_sphere(
        "bsdf-plastic-nonlinear",
        "plastic: nonlinear, int_ior, both colours",
        bsdf(
            "plastic",
            boolean("nonlinear"),
            number("int_ior", 1.9),
            rgb("diffuse_reflectance", "0.8, 0.3, 0.1"),
            rgb("specular_reflectance", "0.5, 0.8, 0.9"),
        ),
    ),
    on_panel(
        "bsdf-plastic-textured",
        "plastic: diffuse_reflectance from a texture",
        bsdf("plastic", bitmap("diffuse_reflectance", "colours.png")),
    ),
    on_sphere("bsdf-roughplastic-default", "roughplastic without parameters", bsdf("roughplastic")),
    *(
        on_sphere(
            f"bsdf-roughplastic-{distribution}{'-nonlinear' if nonlinear else ''}",
            f"roughplastic: {distribution}, {'non' if nonlinear else ''}linear",
            bsdf(
                "roughplastic",
                string("distribution", distribution),
                number("alpha", 0.25),
                number("int_ior", 1.6),
                boolean("nonlinear", nonlinear),
                rgb("diffuse_reflectance", "0.8, 0.3, 0.1"),
                rgb("specular_reflectance", "0.9, 0.8, 0.9"),
            ),
        )
        for distribution in ("ggx", "beckmann")
        for nonlinear in (False, True)
    ),
]

PRINCIPLED = [
    principled("default", "all but the colour at default"),
    principled("roughness", "roughness 0.2", number("roughness", 0.2)),
    principled(
        "metallic", "metallic 1, roughness 0.3", number("metallic", 1.0), number("roughness", 0.3)
    ),
    principled(
        "anisotropic",
        "anisotropic 0.8 on metal",
        number("metallic", 1.0),
        number("roughness", 0.4),
        number("anisotropic", 0.8),
    ),
    principled(
        "specular", "specular 0.9, roughness 0.3", number("specular", 0.9), number("roughness", 0.3)
    ),
    principled("eta", "eta 1.8, roughness 0.3", number("eta", 1.8), number("roughness", 0.3)),
    principled(
        "spec-tint",
        "spec_tint 0.9, specular 0.9",
        number("spec_tint", 0.9),
        number("specular", 0.9),
    ),
    principled("sheen", "sheen 1", number("sheen", 1.0)),
    principled(
        "sheen-tint", "sheen 1, sheen_tint 0.8", number("sheen", 1.0), number("sheen_tint", 0.8)
    ),
    principled("flatness", "flatness 0.9", number("flatness", 0.9)),
    principled(
        "clearcoat", "clearcoat 1", number("clearcoat", 1.0), number("clearcoat_gloss", 0.2)
    ),
    principled(
        "clearcoat-gloss",
        "clearcoat 1, clearcoat_gloss 0.9",
        number("clearcoat", 1.0),
        number("clearcoat_gloss", 0.9),
    ),
    principled(
        "spec-trans",
        "spec_trans 0.8, roughness 0.3",
        number("spec_trans", 0.8),
        number("roughness", 0.3),
    ),
    on_panel(
        "bsdf-principled-textured",
        "principled: base_color, roughness and metallic from textures",
        bsdf(
            "principled",
            bitmap("base_color", "colours.png"),
            bitmap("roughness", "grey.png", raw=True),
            bitmap("metallic", "grey.png", raw=True, wrap_mode="mirror"),
        ),
    ),
    principled_thin("default", "all but the colour at default"),
    principled_thin("diff-trans", "diff_trans 1.2", number("diff_trans", 1.2)),
    principled_thin(
        "spec-trans",
        "spec_trans 0.7, roughness 0.3",
        number("spec_trans", 0.7),
        number("roughness", 0.3),
    ),
    principled_thin(
        "anisotropic",
        "spec_trans 0.5, anisotropic 0.7, spec_tint 0.5, eta 1.7",
        number("spec_trans", 0.5),
        number("anisotropic", 0.7),
        number("spec_tint", 0.5),
        number("eta", 1.7),
    ),
    principled_thin(
        "sheen",
        "sheen 1, sheen_tint 0.6, flatness 0.5",
        number("sheen", 1.0),
        number("sheen_tint", 0.6),
        number("flatness", 0.5),
    ),
]

NESTING = [
    on_panel("bsdf-twosided", "twosided: one material for both sides", bsdf("twosided", RED)),
    Variant(
        "bsdf-twosided-two",
        "twosided: two materials, on rectangles that show their front and their back",
        (
            shape(
                "rectangle",
                to_world(
                    '<scale value="0.8"/>', '<rotate y="1" angle="30"/>', '<translate x="-0.9"/>'
                ),
                bsdf("twosided", RED, ROUGH_GOLD),
            ),
            shape(
                "rectangle",
                to_world(
                    '<scale value="0.8"/>', '<rotate y="1" angle="150"/>', '<translate x="0.9"/>'
                ),
                bsdf("twosided", RED, ROUGH_GOLD),
            ),
        ),
    ),
    on_panel(
        "bsdf-mask-number", "mask: opacity as a number", bsdf("mask", number("opacity", 0.3), RED)
    ),
    on_panel(
        "bsdf-mask-texture",
        "mask: opacity from a texture",
        bsdf("mask", bitmap("opacity", "grey.png", raw=True), bsdf("twosided", RED)),
    ),
    on_panel(
        "bsdf-blend-number",
        "blendbsdf: weight as a number",
        bsdf("blendbsdf", number("weight", 0.3), RED, ROUGH_GOLD),
    ),
    on_panel(
        "bsdf-blend-texture",
        "blendbsdf: weight from a texture",
        bsdf("blendbsdf", bitmap("weight", "grey.png", raw=True), RED, ROUGH_GOLD),
    ),
    on_panel(
        "bsdf-bumpmap",
        "bumpmap: scale",
        bsdf("bumpmap", bitmap("", "heights.png", raw=True), number("scale", 2.0), RED),
    ),
    on_panel(
        "bsdf-bumpmap-rough",
        "bumpmap over a rough conductor inside twosided",
        bsdf("twosided", bsdf("bumpmap", bitmap("", "heights.png", raw=True), ROUGH_GOLD)),
    ),
    on_panel(
        "bsdf-normalmap",
        "normalmap over diffuse",
        bsdf("normalmap", bitmap("normalmap", "normals.png", raw=True), RED),
    ),
    on_panel(
        "bsdf-normalmap-rough",
        "normalmap over a rough conductor",
        bsdf("normalmap", bitmap("normalmap", "normals.png", raw=True), ROUGH_GOLD),
    ),
    Variant(
        "bsdf-null",
        "null: seen through, also by light",
        (
            shape("sphere", number("radius", 0.9), bsdf("null")),
            shape("sphere", number("radius", 0.5), RED),
        ),
    ),
    on_panel(
        "bsdf-one-sided",
        "diffuse without twosided is black from behind",
        RED,
        lights=('<emitter type="constant"><rgb name="radiance" value="1, 0.9, 0.8"/></emitter>',),
    ),
]

BSDFS = [
    on_sphere("bsdf-diffuse-default", "diffuse without parameters", bsdf("diffuse")),
    on_sphere("bsdf-diffuse-colour", "diffuse: reflectance as a colour", RED),
    on_panel(
        "bsdf-diffuse-textured", "diffuse: reflectance from a texture", bsdf("diffuse", COLOURS)
    ),
    *CONDUCTORS,
    *DIELECTRICS,
    *PLASTICS,
    *PRINCIPLED,
    *NESTING,
]


def textured(name: str, what: str, colour: str) -> Variant:
    return on_panel(f"texture-{name}", f"texture: {what}", bsdf("diffuse", colour))


def uv(*steps: str) -> str:
    return f'<transform name="to_uv">{"".join(steps)}</transform>'


TWICE = uv('<scale x="2.2" y="1.7"/>', '<translate x="-0.3" y="0.4"/>')


def wrapped(mode: str) -> str:
    return texture("reflectance", "colours.png", string("wrap_mode", mode) + TWICE)


MESH_COLOUR = '<texture name="reflectance" type="mesh_attribute">{}</texture>'

TEXTURES = [
    *(
        textured(f"bitmap-{mode}", f"bitmap: wrap_mode {mode}", wrapped(mode))
        for mode in ("repeat", "mirror", "clamp")
    ),
    textured(
        "bitmap-nearest",
        "bitmap: filter_type nearest",
        bitmap("reflectance", "colours.png", filter_type="nearest"),
    ),
    textured("bitmap-raw", "bitmap: raw", bitmap("reflectance", "colours.png", raw=True)),
    textured("bitmap-grey", "bitmap: an image of one channel", bitmap("reflectance", "grey.png")),
    textured(
        "bitmap-rgba", "bitmap: an image with alpha", bitmap("reflectance", "colours-alpha.png")
    ),
    textured(
        "bitmap-16-bit", "bitmap: 16 bits per channel", bitmap("reflectance", "colours-16.png")
    ),
    textured("bitmap-exr", "bitmap: an EXR image", bitmap("reflectance", "colours.exr")),
    textured(
        "bitmap-to-uv",
        "bitmap: to_uv with rotation and scale",
        texture(
            "reflectance", "colours.png", uv('<rotate z="1" angle="30"/>', '<scale value="1.6"/>')
        ),
    ),
    textured(
        "checkerboard",
        "checkerboard: both colours, to_uv",
        '<texture name="reflectance" type="checkerboard">'
        + rgb("color0", "0.8, 0.6, 0.1")
        + rgb("color1", "0.1, 0.2, 0.5")
        + uv('<scale x="3" y="2"/>')
        + "</texture>",
    ),
    textured(
        "checkerboard-default",
        "checkerboard: default colours",
        '<texture name="reflectance" type="checkerboard"/>',
    ),
    Variant(
        "texture-mesh-attribute",
        "mesh_attribute: colours at the vertices of a PLY mesh",
        (
            shape(
                "ply",
                string("filename", "assets/patch.ply"),
                bsdf("diffuse", MESH_COLOUR.format(string("name", "vertex_color"))),
            ),
        ),
    ),
    Variant(
        "texture-sphere-uv",
        "bitmap on a turned sphere: its surface coordinates",
        (
            shape(
                "sphere",
                to_world('<rotate x="0.8" y="0.6" angle="50"/>'),
                bsdf("diffuse", bitmap("reflectance", "colours.png")),
            ),
        ),
        floor=(FLOOR,),
    ),
]
