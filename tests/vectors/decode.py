#!/usr/bin/env python3
"""Decodes every vector beside this file and compares what comes out with its .json.

The decoder in `decoder/` was written from docs/spec alone. Needs the packages `zstandard` and `lz4`.
Exit code 0: all agree; 1: something differs.
"""

import json
import pickle
import sys
from pathlib import Path

from decoder.body import Body
from decoder.geometry import digest_of, is_in_order, order_key
from decoder.levels import level_ends, made_anew
from decoder.numbers import Refused
from decoder.octahedral import octahedral
from decoder.paper import PaperState
from decoder.surface import SurfaceLayout, SurfaceState

import wire


def same(expected, found, tolerance=1e-6):
    """Whether two pieces of json agree; numbers with a fraction need not to the last digit."""
    if isinstance(expected, dict) and isinstance(found, dict):
        return expected.keys() == found.keys() and all(same(expected[key], found[key]) for key in expected)
    if isinstance(expected, list) and isinstance(found, list):
        return len(expected) == len(found) and all(map(same, expected, found))
    if isinstance(expected, float) or isinstance(found, float):
        return abs(expected - found) <= tolerance
    return expected == found


class Vectors:
    def __init__(self, folder):
        self.folder = folder
        self.layouts = {
            path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("layouts/*.json"))
        }
        self.states = {}
        self.told = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}

    def empty(self, name):
        layout = self.layouts[name]
        if layout["profile"] == "paper":
            return PaperState(layout)
        return SurfaceState(SurfaceLayout(layout), layout["shared"])

    def check_layout(self, name):
        """Points and digests of the sets of a layout."""
        for entry in self.layouts[name].get("sets", []):
            points = [tuple(point) for point in entry["nodes"]]
            if len(points) != entry["points"] or not is_in_order(entry, points):
                return "the points are not those, or out of order"
            if made_anew(entry, sorted(points, key=order_key)) != (level_ends(entry), points):
                return "the levels are not those that the specification gives"
            if any(chart >= entry["charts"] for *_, chart in points):
                return "a chart is none of the set"
            if f"{digest_of(entry, points):016x}" != entry["digest"]:
                return "the digest is another"
            bits = entry["normal_bits"]
            top = 2 if bits == 2 else (1 << bits) - 1
            for (x, y, z, code, _), sample in zip(points, entry["samples"]):
                place = [entry["origin"][axis] + (x, y, z)[axis] * entry["step"] for axis in range(3)]
                normal = octahedral(code & (1 << bits) - 1, code >> bits, top)
                if not same(sample, {"position": place, "normal": normal}):
                    return f"a point of code {code} is elsewhere: {place} {normal}"
        return None

    def state_before(self, told):
        """The state that a body finds, made from the bodies before it; a copy that may be changed."""
        name = told["after"]
        if name is None:
            return self.empty(told["layout"])
        if name not in self.states:
            state = self.state_before(self.told[name])
            state.apply(Body((self.folder / f"{name}.bin").read_bytes()))
            self.states[name] = pickle.dumps(state)
        return pickle.loads(self.states[name])

    def check(self, name):
        """None, or what is wrong."""
        told = self.told[name]
        try:
            state = self.state_before(told)
        except Refused as refused:
            return f"a body before it is refused for {refused}"
        try:
            body = Body((self.folder / f"{name}.bin").read_bytes())
            state.apply(body)
        except Refused as refused:
            expected = told.get("error", "nothing")
            return None if str(refused) == expected else f"refused for {refused}, told {expected}"
        if "error" in told:
            return f"taken, but should be refused for {told['error']}"
        found = {"frame": body.frame, "time": body.time, "hash": f"{state.hash():016x}"}
        found |= state.report()
        for key, value in told.items():
            if key not in ("layout", "after") and not same(value, found[key]):
                return f"{key}: told {value}, found {found[key]}"
        for index, points in getattr(state, "geometry", {}).items():
            nodes = self.layouts[told["layout"]]["sets"][index]["nodes"]
            if not same(nodes, [list(point) for point in points]):
                return f"set {index} has other points"
        return None


def main():
    here = Path(__file__).resolve().parent
    vectors = Vectors(here / "v1")
    bad = 0
    for name in vectors.layouts:
        problem = vectors.check_layout(name)
        print(f"layout {name}: {problem or 'ok'}")
        bad += problem is not None
    for name in vectors.told:
        problem = vectors.check(name)
        print(f"{name}: {problem or 'ok'}")
        bad += problem is not None
    around = dict(wire.check(here / "v1" / "wire"))
    for name, problem in around.items():
        print(f"wire {name}: {problem or 'ok'}")
        bad += problem is not None
    bodies = len(vectors.told)
    print(f"{bodies} bodies, {len(vectors.layouts)} layouts, {len(around)} around them, {bad} differ")
    return 1 if bad or not bodies or not around else 0


if __name__ == "__main__":
    sys.exit(main())
