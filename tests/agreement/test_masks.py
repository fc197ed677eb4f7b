"""Masks with nothing behind them, against what they must show; here Mitsuba 3.9 is no reference.

Its path integrator drops all light of a path on which every sampled event is null (valid_ray in its
path.cpp), so a mask of opacity a before nothing shows a^2 of its material's radiance.

The scene: a diffuse sheet of reflectance r and opacity a fills the view of an orthographic sensor;
parallel light of irradiance E falls on it at a right angle; there is no environment. Every pixel's
radiance is a r E / pi.

H0: the image's mean is that. Each sample is between 0 and r E / pi, so its variance is at most that
of a coin which falls heads with probability a. Sample size: 16 x 16 pixels of 256 samples.
Threshold: 5 standard deviations, 6e-7 false alarms per channel and test; a^2 instead of a is more
than 100 of them away.
"""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from farm import run

SIZE = 16
SAMPLES = 256
REFLECTANCE = np.array([0.8, 0.5, 0.2])
IRRADIANCE = 3.0

SCENE = """<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="orthographic">
    <transform name="to_world">
      <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
    </transform>
    <film type="hdrfilm">
      <integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/>
    </film>
  </sensor>
  <emitter type="directional">
    <vector name="direction" x="0" y="0" z="-1"/><rgb name="irradiance" value="3"/>
  </emitter>
  <shape type="rectangle">
    <transform name="to_world"><scale value="2"/></transform>
    <bsdf type="mask">
      <float name="opacity" value="{opacity}"/>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.5, 0.2"/></bsdf>
    </bsdf>
  </shape>
</scene>
"""


def mean_of(file: Path) -> np.ndarray:
    with OpenEXR.File(str(file), separate_channels=True) as image:
        channels = image.channels()
        return np.array([channels[name].pixels.astype(np.float64).mean() for name in "RGB"])


@pytest.mark.parametrize("opacity", [0.1, 0.5, 0.9])
def test_a_mask_before_nothing_shows_its_share(opacity: float, tmp_path: Path) -> None:
    scene, image = tmp_path / "scene.xml", tmp_path / "image.exr"
    scene.write_text(SCENE.format(opacity=opacity))
    done = run("render", scene, "-o", image, "--integrator", "path", "--spp", str(SAMPLES))
    assert done.returncode == 0, done.stderr
    full = REFLECTANCE * IRRADIANCE / np.pi
    deviation = full * np.sqrt(opacity * (1 - opacity) / (SIZE * SIZE * SAMPLES))
    distance = (mean_of(image) - opacity * full) / deviation
    assert np.all(np.abs(distance) < 5), f"{distance} standard deviations from {opacity * full}"
