"""Checks the vectors of v1/wire: frames, scene tables, datagrams, recordings."""

import json
import struct

from decoder.datagram import Datagram, Joiner
from decoder.frame import KEYFRAME, UPDATE, Frame
from decoder.messages import read_message
from decoder.numbers import Refused
from decoder.recording import Recording
from decoder.scene import read_table


def same(told, found):
    """Whether two pieces of json agree, numbers with a fraction as the binary32 that they are."""
    if type(told) is not type(found):
        return False
    if isinstance(told, dict):
        return told.keys() == found.keys() and all(same(told[key], found[key]) for key in told)
    if isinstance(told, list):
        return len(told) == len(found) and all(map(same, told, found))
    if isinstance(told, float):
        return struct.pack("<f", told) == struct.pack("<f", found)
    return told == found


def frame(data):
    frame = Frame(data)
    found = {"type": frame.type, "group": frame.group, "sequence": frame.sequence}
    message = read_message(frame.type, frame.payload)
    if message is not None:
        return found | {"message": message}
    content = "body" if frame.type in (KEYFRAME, UPDATE) else "payload"
    return found | {content: frame.payload.hex()}


def datagrams(data, told):
    """What becomes of the datagrams that a file has one after the other."""
    joiner = Joiner(told["here"]) if told["to"] == "client" else None
    at, items = 0, []
    for length in (item["length"] for item in told["datagrams"]):
        datagram, at = data[at : at + length], at + length
        item = {"length": length}
        if joiner:
            item["outcome"], whole = joiner.take(datagram)
            if whole:
                item |= {"frame": whole[0], "body": whole[1].hex()}
        else:
            try:
                item |= {"message": Datagram(datagram).acknowledged(), "outcome": "acknowledged"}
            except Refused:
                item["outcome"] = "bad"
        items.append(item)
    return told | {"datagrams": items}


def found_in(path, told):
    """What a reader makes of a file."""
    if path.suffix == ".psao":
        return Recording(path.read_bytes()).report()
    if path.stem.startswith("table-"):
        return read_table(path.read_bytes()).report()
    if "datagrams" in told:
        return datagrams(path.read_bytes(), told)
    return frame(path.read_bytes())


def check(folder):
    """Names and problems; None where there is none."""
    for path in sorted(folder.iterdir()):
        if path.suffix == ".json":
            continue
        told = json.loads(path.with_suffix(".json").read_text())
        try:
            found = found_in(path, told)
        except Refused as refused:
            found = {"error": str(refused)}
        yield path.stem, None if same(told, found) else f"told {told}, found {found}"
