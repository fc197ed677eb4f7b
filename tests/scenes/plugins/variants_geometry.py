"""Shapes, sensors, and forms of the file format."""

from xml_parts import (
    LOOK,
    Variant,
    bitmap,
    boolean,
    bsdf,
    film,
    number,
    rgb,
    sensor,
    shape,
    string,
    to_world,
)

# Shows the normals and the surface coordinates of the shape that wears it.
COLOURED = bsdf("diffuse", bitmap("reflectance", "colours.png"))
GLOSSY = bsdf("roughconductor", number("alpha", 0.2))
GLASS = bsdf("dielectric")
TURNED = to_world('<rotate x="0.48" y="0.6" z="0.64" angle="60"/>')


def shaped(name: str, purpose: str, *shapes: str) -> Variant:
    return Variant(f"shape-{name}", purpose, shapes)


def both(type: str, *parameters: str) -> tuple[str, ...]:
    """The shape twice, textured on the left and glossy on the right, each 0.8 times as large."""
    return tuple(
        shape(
            type,
            *parameters,
            to_world(
                '<rotate x="0.48" y="0.6" z="0.64" angle="60"/>',
                '<scale value="0.8"/>',
                f'<translate x="{x}" y="-0.1"/>',
            ),
            material,
        )
        for x, material in ((-0.95, COLOURED), (0.95, GLOSSY))
    )


GROUP = """<shape type="shapegroup" id="group">
  <shape type="sphere"><float name="radius" value="0.4"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.2, 0.1"/></bsdf></shape>
  <shape type="obj"><string name="filename" value="assets/wedge.obj"/>
    <transform name="to_world"><scale value="0.4"/><translate x="0.6"/></transform>
    <bsdf type="diffuse"><texture name="reflectance" type="bitmap">
      <string name="filename" value="assets/colours.png"/></texture></bsdf></shape>
</shape>"""


def instance(*steps: str) -> str:
    return shape("instance", '<ref id="group"/>', to_world(*steps))


SHAPES = [
    shaped("rectangle", "rectangle: normal, surface coordinates", *both("rectangle")),
    shaped("cube", "cube: normals, surface coordinates", *both("cube")),
    shaped(
        "sphere",
        "sphere: center, radius",
        *(
            shape(
                "sphere",
                f'<point name="center" x="{x}" y="-0.2" z="0.1"/>',
                number("radius", 0.7),
                m,
            )
            for x, m in ((-0.9, COLOURED), (0.9, GLOSSY))
        ),
    ),
    shaped("disk", "disk: normal, surface coordinates", *both("disk")),
    shaped("cylinder", "cylinder: normal, surface coordinates", *both("cylinder")),
    shaped(
        "cylinder-points",
        "cylinder: p0, p1, radius",
        shape(
            "cylinder",
            '<point name="p0" x="-1" y="-0.8" z="0"/>',
            '<point name="p1" x="0.9" y="0.5" z="0.4"/>',
            number("radius", 0.4),
            bsdf("twosided", COLOURED),
        ),
    ),
    shaped(
        "obj",
        "obj: normals and texture coordinates from the file",
        *both("obj", string("filename", "assets/wedge.obj")),
    ),
    shaped(
        "obj-no-flip",
        "obj: flip_tex_coords off",
        *both("obj", string("filename", "assets/wedge.obj"), boolean("flip_tex_coords", False)),
    ),
    shaped(
        "obj-face-normals",
        "obj: face_normals",
        *both("obj", string("filename", "assets/wedge.obj"), boolean("face_normals")),
    ),
    shaped(
        "obj-bare",
        "obj: positions only; smooth normals are made",
        shape("obj", string("filename", "assets/bare.obj"), GLOSSY),
    ),
    shaped(
        "ply",
        "ply: ascii with normals and texture coordinates",
        *both("ply", string("filename", "assets/patch.ply")),
    ),
    shaped(
        "ply-binary", "ply: binary", *both("ply", string("filename", "assets/patch-binary.ply"))
    ),
    shaped(
        "ply-face-normals",
        "ply: face_normals",
        *both("ply", string("filename", "assets/patch.ply"), boolean("face_normals")),
    ),
    shaped(
        "serialized",
        "serialized: the second of two meshes",
        *both(
            "serialized",
            string("filename", "assets/meshes.serialized"),
            '<integer name="shape_index" value="1"/>',
        ),
    ),
    shaped(
        "flip-normals",
        "flip_normals: glass spheres whose inside is outside, and a rectangle",
        shape(
            "sphere",
            boolean("flip_normals"),
            number("radius", 0.7),
            to_world('<translate x="-0.9"/>'),
            GLASS,
        ),
        shape(
            "rectangle",
            boolean("flip_normals"),
            to_world('<scale value="0.7"/>', '<rotate y="1" angle="160"/>', '<translate x="0.9"/>'),
            COLOURED,
        ),
    ),
    shaped(
        "flip-normals-light",
        "flip_normals on an area light",
        shape(
            "rectangle",
            boolean("flip_normals"),
            to_world('<rotate x="1" angle="-60"/>', '<translate y="1"/>'),
            '<emitter type="area"><rgb name="radiance" value="2, 3, 4"/></emitter>',
        ),
        shape("sphere", number("radius", 0.6), COLOURED),
    ),
    shaped(
        "sphere-scaled",
        "sphere: to_world with rotation and even scale",
        shape("sphere", to_world('<scale value="0.8"/>', '<rotate z="1" angle="40"/>'), COLOURED),
    ),
    shaped(
        "mesh-mirrored",
        "obj: to_world that mirrors",
        shape(
            "obj",
            string("filename", "assets/wedge.obj"),
            to_world('<scale x="-1" y="1" z="0.7"/>'),
            COLOURED,
        ),
    ),
    shaped(
        "mesh-glass",
        "obj: glass, smooth normals",
        shape("obj", string("filename", "assets/bare.obj"), GLASS),
    ),
    shaped(
        "instance",
        "instances of a shapegroup: turned, scaled, mirrored",
        GROUP,
        instance('<rotate y="1" angle="20"/>', '<translate x="-1" y="-0.3"/>'),
        instance('<scale x="1" y="1.6" z="0.8"/>', '<translate x="0.3" y="0.1"/>'),
        instance(
            '<scale x="-1" y="1" z="1"/>',
            '<rotate z="1" angle="30"/>',
            '<translate x="1" y="0.8" z="-0.8"/>',
        ),
    ),
    Variant(
        "shape-coarse-smooth",
        "smooth shading on a coarse mesh",
        (
            shape(
                "obj",
                string("filename", "assets/bare.obj"),
                bsdf("diffuse", rgb("reflectance", "0.8")),
            ),
        ),
    ),
]


def seen(name: str, purpose: str, **how: str) -> Variant:
    return Variant(
        f"sensor-{name}",
        f"sensor: {purpose}",
        (shape("cube", TURNED, COLOURED),),
        sensor=sensor(**how),
    )


def fov(axis: str) -> str:
    return string("fov_axis", axis) + number("fov", 38)


ROLLED = '<lookat origin="1, 1.5, 4" target="0, 0, 0" up="0.3, 1, 0"/>'
CROP = "".join(
    f'<integer name="crop_{key}" value="{value}"/>\n'
    for key, value in (("offset_x", 4), ("offset_y", 8), ("width", 16), ("height", 12))
)

SENSORS = [
    *(
        seen(
            f"fov-{axis}",
            f"perspective: fov_axis {axis} on a wide film",
            parameters=fov(axis),
            film=film(24, 12),
        )
        for axis in ("x", "y", "diagonal", "smaller", "larger")
    ),
    seen(
        "fov-larger-tall",
        "perspective: fov_axis larger on a tall film",
        parameters=fov("larger"),
        film=film(12, 24),
    ),
    seen(
        "focal-length",
        "perspective: focal_length",
        parameters=string("focal_length", "60mm"),
        film=film(24, 16),
    ),
    seen("rolled", "perspective: a tilted up vector", transform=ROLLED),
    seen(
        "principal-point",
        "perspective: principal point offset",
        parameters=fov("x")
        + number("principal_point_offset_x", 0.2)
        + number("principal_point_offset_y", -0.1),
        film=film(24, 16),
    ),
    seen(
        "clip",
        "perspective: near_clip and far_clip cut the scene",
        parameters=fov("x") + number("near_clip", 4.0) + number("far_clip", 5.5),
    ),
    seen("crop", "film: crop window", film=film(24, 24, more=CROP)),
    seen(
        "thinlens",
        "thinlens: aperture_radius and focus_distance",
        type="thinlens",
        parameters=fov("x") + number("aperture_radius", 0.3) + number("focus_distance", 3.5),
    ),
    seen(
        "orthographic",
        "orthographic",
        type="orthographic",
        parameters="",
        transform='<scale x="1.6" y="1.6" z="1"/>' + LOOK,
        film=film(24, 16),
    ),
    Variant(
        "sensor-hide-emitters",
        "integrator: hide_emitters",
        (shape("sphere", COLOURED),),
        sensor=sensor(transform='<lookat origin="0, 0.5, 6" target="0, 0.8, 0" up="0, 1, 0"/>'),
        integrator='<integrator type="path"><integer name="max_depth" value="6"/>'
        '<boolean name="hide_emitters" value="true"/></integrator>',
    ),
    Variant(
        "sensor-max-depth",
        "integrator: max_depth 2",
        (shape("cube", TURNED, COLOURED),),
        integrator='<integrator type="path"><integer name="max_depth" value="2"/></integrator>',
    ),
    Variant(
        "sensor-direct",
        "integrator: direct",
        (shape("cube", TURNED, COLOURED),),
        integrator='<integrator type="direct"/>',
    ),
]

OLD_FORM = """<integrator type="path"><integer name="maxDepth" value="6"/></integrator>
<sensor type="perspective">
  <float name="fov" value="38"/><string name="fovAxis" value="x"/>
  <transform name="toWorld"><lookat origin="0, 1.2, 4.5" target="0, 0, 0" up="0, 1, 0"/></transform>
  <sampler type="independent"><integer name="sampleCount" value="16"/></sampler>
  <film type="hdrfilm">
    <integer name="width" value="16"/><integer name="height" value="16"/>
    <rfilter type="box"/>
  </film>
</sensor>
<shape type="rectangle">
  <transform name="toWorld">
    <rotate x="1" angle="-90"/><scale value="3"/><translate y="-1"/>
  </transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf>
</shape>
<emitter type="point"><point name="position" x="1" y="3" z="2"/>
  <spectrum name="intensity" value="12"/></emitter>
<shape type="sphere">
  <bsdf type="roughplastic"><float name="intIOR" value="1.6"/><float name="alpha" value="0.2"/>
    <rgb name="diffuseReflectance" value="0.2, 0.5, 0.3"/></bsdf>
</shape>"""

FORMS = """<default name="colour" value="0.7, 0.2, 0.1"/>
<default name="size" value="0.8"/>
<bsdf type="diffuse" id="paint"><rgb name="reflectance" value="$colour"/></bsdf>
<alias id="paint" as="other"/>
<path value="assets"/>
<include filename="assets/included.xml"/>
<shape type="sphere"><float name="radius" value="$size"/><ref id="other"/></shape>"""

MATRIX = '<matrix value="0.8 0 0.1 0.2  0 0.6 0 -0.3  -0.1 0 0.9 1.5e-001  0 0 0 1"/>'

FORMATS = [
    Variant(
        "format-0-6",
        "the 0.6 form: camelCase names, which Mitsuba 3 converts",
        (OLD_FORM,),
        lights=(),
        sensor="",
        integrator="",
        floor=(),
        version="0.6.0",
    ),
    Variant("format-directives", "default, $name, ref, alias, path, include", (FORMS,)),
    Variant(
        "format-transforms",
        "matrix, and steps in order",
        (
            shape("cube", to_world(MATRIX), COLOURED),
            shape(
                "sphere",
                number("radius", 0.3),
                to_world(
                    '<translate value="0.5"/>',
                    '<rotate value="0, 1, 0" angle="100"/>',
                    '<scale value="1.3"/>',
                ),
                GLOSSY,
            ),
        ),
    ),
    Variant(
        "format-rotate-axis",
        "rotate about an axis that is not of unit length, which Mitsuba 3 takes as it is",
        (
            shape(
                "rectangle",
                to_world('<rotate x="0.9" y="0.6" angle="40"/>', '<scale value="0.9"/>'),
                COLOURED,
            ),
        ),
    ),
]
