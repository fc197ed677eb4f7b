"""Pieces of Mitsuba 3 XML that the tables of variants are put together from."""

from dataclasses import dataclass, field
from textwrap import indent


def film(
    width: int = 16, height: int = 16, rfilter: str = '<rfilter type="box"/>', more: str = ""
) -> str:
    return f"""<film type="hdrfilm">
  <integer name="width" value="{width}"/>
  <integer name="height" value="{height}"/>
{indent(more + rfilter, "  ")}
</film>"""


LOOK = '<lookat origin="0, 1.2, 4.5" target="0, 0, 0" up="0, 1, 0"/>'


def sensor(
    type: str = "perspective",
    parameters: str = '<float name="fov" value="38"/>',
    film: str = film(),
    transform: str = LOOK,
) -> str:
    return f"""<sensor type="{type}">
  <transform name="to_world">{transform}</transform>
{indent(parameters, "  ")}
{indent(film, "  ")}
</sensor>"""


PATHS = '<integrator type="path"><integer name="max_depth" value="6"/></integrator>'


def texture(name: str, file: str, more: str = "") -> str:
    return (
        f'<texture name="{name}" type="bitmap">'
        f'<string name="filename" value="assets/{file}"/>{more}</texture>'
    )


def bitmap(name: str, file: str, *, raw: bool = False, **strings: str) -> str:
    words = '<boolean name="raw" value="true"/>' if raw else ""
    words += "".join(f'<string name="{key}" value="{value}"/>' for key, value in strings.items())
    return texture(name, file, words)


def rgb(name: str, value: str) -> str:
    return f'<rgb name="{name}" value="{value}"/>'


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value}"/>'


def string(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


def boolean(name: str, value: bool = True) -> str:
    return f'<boolean name="{name}" value="{str(value).lower()}"/>'


def to_world(*steps: str) -> str:
    return f'<transform name="to_world">{"".join(steps)}</transform>'


def bsdf(type: str, *parameters: str) -> str:
    return f'<bsdf type="{type}">{"".join(parameters)}</bsdf>'


def shape(type: str, *parameters: str) -> str:
    return f'<shape type="{type}">{"".join(parameters)}</shape>'


FLOOR = """<shape type="rectangle">
  <transform name="to_world">
    <rotate x="1" angle="-90"/><scale value="3"/><translate y="-1"/>
  </transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.3"/></bsdf>
</shape>"""

# Large, so that what glass gathers of it converges too.
LAMP = """<shape type="rectangle">
  <transform name="to_world">
    <rotate x="1" angle="90"/><scale value="1.5"/><translate x="0.5" y="3" z="1"/>
  </transform>
  <emitter type="area"><rgb name="radiance" value="3, 2.5, 2"/></emitter>
</shape>"""

SKY = '<emitter type="constant"><rgb name="radiance" value="0.3, 0.4, 0.5"/></emitter>'


@dataclass(frozen=True)
class Variant:
    """A scene: the parts under test and, where they are not the subject, the usual rest.

    The twin is the same scene in a form that Mitsuba 3 loads, for those that it does not."""

    name: str
    purpose: str
    parts: tuple[str, ...]
    lights: tuple[str, ...] = (LAMP, SKY)
    sensor: str = field(default_factory=sensor)
    integrator: str = PATHS
    floor: tuple[str, ...] = (FLOOR,)
    version: str = "3.0.0"
    twin: "Variant | None" = None

    def document(self) -> str:
        body = [self.integrator, self.sensor, *self.lights, *self.floor, *self.parts]
        text = "\n".join(indent(part, "  ") for part in body if part)
        return f'<!-- {self.purpose}. -->\n<scene version="{self.version}">\n{text}\n</scene>\n'


def on_sphere(name: str, purpose: str, material: str, **rest: object) -> Variant:
    """The material on a sphere."""
    return Variant(name, purpose, (shape("sphere", "\n  " + material + "\n"),), **rest)


def on_panel(name: str, purpose: str, material: str, **rest: object) -> Variant:
    """The material on a rectangle that faces the camera and leans back."""
    pose = to_world('<rotate x="1" angle="-20"/>', '<translate y="0.1"/>')
    return Variant(name, purpose, (shape("rectangle", pose, "\n  " + material + "\n"),), **rest)
