#!/usr/bin/env python3
"""One image by Mitsuba 3: stored as a numpy array, its CPU seconds printed as JSON.

usage: mitsuba_image.py VARIANT SCENE.xml SPP WIDTH HEIGHT SEED OUT.npy

Loading, compilation and a first pass that the just-in-time compiler needs are not counted.
"""

import json
import resource
import sys

import drjit
import mitsuba
import numpy as np

THREADS = 2
# The llvm variant keeps every sample of a pass in memory.
SAMPLES_PER_PASS = 1 << 24


def cpu_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    variant, path, out = sys.argv[1], sys.argv[2], sys.argv[7]
    spp, width, height, seed = map(int, sys.argv[3:7])
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)  # warnings go to standard output
    drjit.set_thread_count(THREADS)
    scene = mitsuba.load_file(path)
    film = mitsuba.traverse(scene.sensors()[0])
    film["film.size"] = [width, height]
    film.update()
    passes = max(1, -(-spp * width * height // SAMPLES_PER_PASS))
    per_pass = -(-spp // passes)
    drjit.eval(mitsuba.render(scene, spp=per_pass, seed=0))
    drjit.sync_thread()
    started = cpu_seconds()
    total = np.zeros((height, width, 3))
    for number in range(passes):
        image = mitsuba.render(scene, spp=per_pass, seed=1 + seed * passes + number)
        total += np.array(image)[..., :3]
    seconds = cpu_seconds() - started
    np.save(out, total / passes)
    print(json.dumps({"cpu_seconds": seconds, "spp": per_pass * passes}))


if __name__ == "__main__":
    main()
