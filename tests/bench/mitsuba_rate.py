#!/usr/bin/env python3
"""Mitsuba's samples per CPU second on one scene, as JSON.

usage: mitsuba_rate.py VARIANT SCENE.xml SPP SIZE THREADS
"""

import json
import resource
import sys

import drjit
import mitsuba


def cpu_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    variant, path, spp, size, threads = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6])
    mitsuba.set_variant(variant)
    drjit.set_thread_count(threads)
    # Reflects a size onto scenes that have no <default> for it, so both renderers do the same.
    scene = mitsuba.load_file(path)
    film = mitsuba.traverse(scene.sensors()[0])
    film["film.size"] = [size, size]
    film.update()
    # The first pass compiles.
    drjit.eval(mitsuba.render(scene, spp=1, seed=1))
    drjit.sync_thread()
    drjit.eval(mitsuba.render(scene, spp=spp, seed=2))
    drjit.sync_thread()
    started = cpu_seconds()
    drjit.eval(mitsuba.render(scene, spp=spp, seed=3))
    drjit.sync_thread()
    seconds = cpu_seconds() - started
    rate = size * size * spp / seconds
    print(json.dumps({"samples_per_cpu_second": rate, "cpu_seconds": seconds}))


if __name__ == "__main__":
    main()
