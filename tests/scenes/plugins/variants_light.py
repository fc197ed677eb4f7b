"""Emitters, reconstruction filters and spectra."""

import math

from xml_parts import (
    SKY,
    Variant,
    bitmap,
    bsdf,
    film,
    number,
    on_sphere,
    rgb,
    sensor,
    shape,
    string,
    to_world,
)

GREY_BALL = shape("sphere", bsdf("diffuse", rgb("reflectance", "0.5, 0.6, 0.7")))
ABOVE = to_world('<lookat origin="1.5, 3, 2" target="0, -0.5, 0" up="0, 1, 0"/>')
FROM_THE_SIDE = to_world('<lookat origin="2, 3, 2.5" target="0, -0.5, 0" up="0, 1, 0"/>')


Z_UP = to_world('<rotate x="1" angle="-90"/>')
LOW_SUN = '<vector name="sun_direction" x="-0.6" y="0.25" z="0.5"/>'
SUN_DIRECTION = '<vector name="sun_direction" x="0.4" y="0.7" z="0.5"/>'


def emitter(type: str, *parameters: str) -> str:
    return f'<emitter type="{type}">{"".join(parameters)}</emitter>'


def lit(name: str, purpose: str, *lights: str) -> Variant:
    return Variant(f"emitter-{name}", purpose, (GREY_BALL,), lights=lights)


def lamp(radiance: str) -> str:
    pose = to_world(
        '<rotate x="1" angle="90"/>', '<scale value="1.5"/>', '<translate x="0.5" y="3" z="1"/>'
    )
    return shape("rectangle", pose, emitter("area", radiance))


EMITTERS = [
    lit("area-textured", "area: radiance from a texture", lamp(bitmap("radiance", "colours.exr"))),
    Variant(
        "emitter-area-shapes",
        "area: lights of five shapes that are also seen",
        (
            shape(
                "sphere",
                number("radius", 0.3),
                to_world('<translate x="-1.2" y="0.6"/>'),
                emitter("area", rgb("radiance", "3, 1, 1")),
            ),
            shape(
                "disk",
                to_world(
                    '<scale value="0.4"/>',
                    '<rotate y="1" angle="20"/>',
                    '<translate x="-0.5" y="0.6" z="-0.5"/>',
                ),
                emitter("area", rgb("radiance", "1, 3, 1")),
            ),
            shape(
                "cylinder",
                number("radius", 0.2),
                to_world('<rotate x="1" angle="-70"/>', '<translate x="0.3" z="-0.5"/>'),
                emitter("area", rgb("radiance", "1, 1, 3")),
            ),
            shape(
                "cube",
                to_world(
                    '<scale value="0.25"/>',
                    '<rotate y="1" angle="30"/>',
                    '<translate x="1.1" y="0.5"/>',
                ),
                emitter("area", rgb("radiance", "2, 2, 0.5")),
            ),
            shape(
                "obj",
                string("filename", "assets/wedge.obj"),
                to_world('<scale value="0.4"/>', '<translate y="-0.6" z="0.8"/>'),
                emitter("area", rgb("radiance", "1, 2, 2")),
            ),
        ),
        lights=(),
    ),
    lit(
        "point",
        "point: position",
        emitter(
            "point", '<point name="position" x="1" y="2.5" z="2"/>', rgb("intensity", "9, 8, 6")
        ),
    ),
    lit(
        "point-to-world",
        "point: to_world",
        emitter("point", to_world('<translate x="-1" y="2" z="2"/>'), rgb("intensity", "9, 8, 6")),
    ),
    lit(
        "spot",
        "spot: cutoff_angle and beam_width",
        emitter(
            "spot",
            ABOVE,
            number("cutoff_angle", 30),
            number("beam_width", 12),
            rgb("intensity", "30, 25, 20"),
        ),
    ),
    lit(
        "spot-default",
        "spot: default angles",
        emitter("spot", ABOVE, rgb("intensity", "30, 25, 20")),
    ),
    lit(
        "spot-textured",
        "spot: texture",
        emitter(
            "spot",
            ABOVE,
            number("cutoff_angle", 35),
            number("beam_width", 30),
            rgb("intensity", "30, 25, 20"),
            bitmap("texture", "colours.png"),
        ),
    ),
    lit(
        "directional",
        "directional: direction",
        emitter(
            "directional",
            '<vector name="direction" x="-0.6" y="-1" z="-0.5"/>',
            rgb("irradiance", "2, 1.8, 1.5"),
        ),
    ),
    lit(
        "directional-to-world",
        "directional: to_world",
        emitter("directional", FROM_THE_SIDE, rgb("irradiance", "2, 1.8, 1.5")),
    ),
    lit("constant", "constant", emitter("constant", rgb("radiance", "0.9, 0.7, 0.5"))),
    lit(
        "envmap",
        "envmap: scale",
        emitter("envmap", string("filename", "assets/sky.exr"), number("scale", 0.8)),
    ),
    lit(
        "envmap-rotated",
        "envmap: to_world",
        emitter(
            "envmap",
            string("filename", "assets/sky.exr"),
            to_world('<rotate x="1" angle="70"/>', '<rotate y="0.96" z="0.28" angle="130"/>'),
        ),
    ),
    on_sphere(
        "emitter-envmap-mirror",
        "envmap: seen and in a mirror, so which way it turns",
        bsdf("conductor"),
        lights=(
            emitter(
                "envmap",
                string("filename", "assets/sky.exr"),
                to_world('<rotate y="1" angle="40"/>'),
            ),
        ),
    ),
    lit(
        "projector",
        "projector: fov, scale, a wide image",
        emitter(
            "projector",
            ABOVE,
            number("fov", 50),
            number("scale", 3),
            bitmap("irradiance", "wide.png"),
        ),
    ),
    lit(
        "projector-fov-axis",
        "projector: fov_axis y",
        emitter(
            "projector",
            ABOVE,
            number("fov", 40),
            string("fov_axis", "y"),
            number("scale", 3),
            bitmap("irradiance", "wide.png"),
        ),
    ),
    lit(
        "sky",
        "sunsky: the sky alone",
        emitter("sunsky", SUN_DIRECTION, Z_UP, number("sun_scale", 0), number("turbidity", 4)),
    ),
    lit("sunsky", "sunsky: sun and sky", emitter("sunsky", SUN_DIRECTION, Z_UP)),
    lit(
        "sun",
        "sunsky: the sun alone",
        emitter("sunsky", SUN_DIRECTION, Z_UP, number("sky_scale", 0)),
    ),
    lit(
        "sun-wide",
        "sunsky: a low and wide sun, a weak one in a bright sky",
        emitter(
            "sunsky",
            LOW_SUN,
            Z_UP,
            number("sun_aperture", 10),
            number("sun_scale", 0.5),
            number("sky_scale", 2),
            rgb("albedo", "0.2, 0.4, 0.6"),
        ),
    ),
    lit(
        "several",
        "several kinds at once, so light selection",
        emitter(
            "point", '<point name="position" x="1" y="2.5" z="2"/>', rgb("intensity", "4, 1, 1")
        ),
        emitter("spot", ABOVE, rgb("intensity", "10, 20, 10")),
        emitter("directional", FROM_THE_SIDE, rgb("irradiance", "0.2, 0.2, 0.9")),
        lamp(rgb("radiance", "0.5, 0.5, 0.2")),
        SKY,
    ),
]

CHECKS = shape(
    "rectangle",
    bsdf(
        "diffuse",
        '<texture name="reflectance" type="checkerboard">'
        + rgb("color0", "0.9")
        + rgb("color1", "0.05")
        + '<transform name="to_uv"><scale value="4"/></transform></texture>',
    ),
)


def filtered(name: str, rfilter: str) -> Variant:
    return Variant(
        f"filter-{name}",
        f"reconstruction filter: {name}",
        (CHECKS,),
        lights=(
            emitter(
                "point",
                '<point name="position" x="0.5" y="1" z="4"/>',
                rgb("intensity", "20, 15, 10"),
            ),
        ),
        sensor=sensor(film=film(rfilter=rfilter)),
        floor=(),
    )


FILTERS = [
    filtered("box", '<rfilter type="box"/>'),
    filtered("tent", '<rfilter type="tent"/>'),
    filtered("gaussian", '<rfilter type="gaussian"/>'),
    filtered(
        "gaussian-stddev", '<rfilter type="gaussian"><float name="stddev" value="0.8"/></rfilter>'
    ),
    filtered("mitchell", '<rfilter type="mitchell"/>'),
    filtered(
        "mitchell-b-c",
        '<rfilter type="mitchell"><float name="B" value="0.6"/>'
        '<float name="C" value="0.2"/></rfilter>',
    ),
    filtered("catmullrom", '<rfilter type="catmullrom"/>'),
    filtered("lanczos", '<rfilter type="lanczos"/>'),
    filtered(
        "lanczos-lobes", '<rfilter type="lanczos"><integer name="lobes" value="2"/></rfilter>'
    ),
]


def coloured(name: str, purpose: str, reflectance: str, **rest: object) -> Variant:
    return on_sphere(
        f"spectrum-{name}", f"spectra: {purpose}", bsdf("diffuse", reflectance), **rest
    )


def twin_coloured(name: str, purpose: str, reflectance: str, same: str, version: str) -> Variant:
    return coloured(name, purpose, reflectance, version=version, twin=coloured(name, purpose, same))


def glowing(name: str, purpose: str, radiance: str) -> Variant:
    return Variant(
        f"spectrum-{name}", f"spectra: {purpose}", (GREY_BALL,), lights=(lamp(radiance),)
    )


def planck(temperature: float) -> str:
    """Spectral radiance of a black body in W / (m^2 sr nm), every 5 nm."""
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23

    def radiance(nm: float) -> float:
        wavelength = nm * 1e-9
        exponent = h * c / (wavelength * k * temperature)
        return 1e-9 * 2 * h * c**2 / wavelength**5 / math.expm1(exponent)

    pairs = ", ".join(f"{nm}:{radiance(nm):.6g}" for nm in range(360, 831, 5))
    return f'<spectrum name="radiance" value="{pairs}"/>'


SPECTRA = [
    coloured("rgb", "rgb with spaces", '<rgb name="reflectance" value="0.2 0.5 0.8"/>'),
    coloured("rgb-single", "rgb of one number", '<rgb name="reflectance" value="0.4"/>'),
    twin_coloured(
        "hex",
        "rgb as #hex, which is sRGB",
        '<rgb name="reflectance" value="#c04020"/>',
        '<rgb name="reflectance" value="0.527115, 0.051269, 0.014444"/>',
        "3.0.0",
    ),
    twin_coloured(
        "srgb-0-6",
        "srgb of 0.6",
        '<srgb name="reflectance" value="0.6, 0.4, 0.2"/>',
        '<rgb name="reflectance" value="0.318547, 0.132868, 0.033105"/>',
        "0.6.0",
    ),
    coloured("constant", "spectrum of one number", '<spectrum name="reflectance" value="0.35"/>'),
    coloured(
        "wavelengths",
        "reflectance by wavelength",
        '<spectrum name="reflectance" value="400:0.1, 480:0.2, 560:0.7, 640:0.8, 700:0.3"/>',
    ),
    glowing(
        "wavelengths-emission",
        "emission by wavelength",
        '<spectrum name="radiance" value="400:1.0, 500:2.0, 600:4.0, 700:5.0"/>',
    ),
    glowing(
        "constant-emission", "emission of one number", '<spectrum name="radiance" value="2.5"/>'
    ),
    Variant(
        "spectrum-blackbody",
        "spectra: blackbody; Mitsuba has none in RGB, so the twin tabulates Planck's law",
        (GREY_BALL,),
        lights=(
            lamp(
                '<spectrum name="radiance" type="blackbody">'
                '<float name="temperature" value="4000"/></spectrum>'
            ),
        ),
        twin=glowing("blackbody", "the twin of spectrum-blackbody", planck(4000)),
    ),
    glowing(
        "d65",
        "d65 with a scale",
        '<spectrum name="radiance" type="d65"><float name="scale" value="2"/></spectrum>',
    ),
    twin_coloured(
        "irregular",
        "irregular: wavelengths and values; Mitsuba has the plugin in spectral variants only",
        '<spectrum name="reflectance" type="irregular">'
        '<string name="wavelengths" value="400, 500, 600, 700"/>'
        '<string name="values" value="0.7, 0.4, 0.3, 0.1"/></spectrum>',
        '<spectrum name="reflectance" value="400:0.7, 500:0.4, 600:0.3, 700:0.1"/>',
        "3.0.0",
    ),
    coloured(
        "uniform",
        "uniform",
        '<spectrum name="reflectance" type="uniform"><float name="value" value="0.45"/></spectrum>',
    ),
    coloured(
        "srgb",
        "srgb as a plugin",
        '<texture name="reflectance" type="srgb">'
        '<rgb name="color" value="0.3, 0.6, 0.2"/></texture>',
    ),
    on_sphere(
        "spectrum-conductor-wavelengths",
        "spectra: eta and k by wavelength",
        bsdf(
            "conductor",
            '<spectrum name="eta" value="400:1.5, 550:0.9, 700:0.2"/>',
            '<spectrum name="k" value="400:2, 550:2.6, 700:4"/>',
        ),
    ),
]
