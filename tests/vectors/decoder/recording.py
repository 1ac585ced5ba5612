"""Recordings: docs/spec/recording.md."""

from .body import Body
from .frame import INDEX, KEYFRAME, Frame
from .messages import CLOSE, read_message
from .numbers import Refused, crc32c, must

MAGIC = b"\x89PSAO\r\n\x1a"
FOOTER_MAGIC = (0x1D0AA05E).to_bytes(4, "little")
SIXTEEN, HEAD, ENTRY = 16, 12, 24
SCENE, EDIT, PARITY = 4, 6, 66
COVERED, PASSES = 131_072, 3
# How often the file's length may be checked in vain.
PATIENCE = 16


def number(data, at, size):
    return int.from_bytes(data[at : at + size], "little")


def sealed(data, at, size):
    """Whether a checksum of what is before it is at the end of `size` bytes."""
    end = at + size
    return end <= len(data) and number(data, end - 4, 4) == crc32c(data[at : end - 4])


def is_footer(data, at):
    return data[at + 8 : at + 12] == FOOTER_MAGIC and sealed(data, at, SIXTEEN)


class Recording:
    """Records and damages of a file, in their order."""

    def __init__(self, data):
        self.data, self.patience = data, PATIENCE * len(data)
        self.records, self.damages = [], []
        if data[:8] == MAGIC and sealed(data, 0, SIXTEEN):
            must(number(data, 8, 2) == 1, "version")
            must(number(data, 10, 2) == 0, "flags")
            self.read(SIXTEEN)
        else:
            must(any(self.is_record(at) for at in range(len(data))), "recording")
            self.patience = PATIENCE * len(data)
            self.read(0)

    def record(self, at):
        """The frame of the record at an offset; refused for what is damaged."""
        data = self.data
        must(len(data) - at >= SIXTEEN, "ends")
        must(sealed(data, at, HEAD), "arrival")
        try:
            return Frame(data[at + HEAD :])
        except Refused as refused:
            if str(refused) == "checksum":
                self.patience -= number(data, at + HEAD + 4, 4)
            raise Refused("ends" if str(refused) == "unfinished" else "frame") from refused

    def is_record(self, at):
        # Most offsets are none, and a checksum takes its time.
        if self.data[at + HEAD : at + HEAD + 2] != b"\x50\xa0" or self.patience <= 0:
            return False
        try:
            self.record(at)
        except Refused:
            return False
        return True

    def read(self, at):
        while at < len(self.data):
            try:
                frame = self.record(at)
                self.records.append((at, number(self.data, at, 8), frame))
                at += HEAD + frame.size
            except Refused as refused:
                if is_footer(self.data, at):
                    at += SIXTEEN
                else:
                    at = self.damaged(at, str(refused))

    def damaged(self, start, kind):
        """Goes to where reading goes on."""
        data = self.data
        places = range(start + 1, len(data))
        end = next((at for at in places if self.is_record(at) or is_footer(data, at)), None)
        if end is None and self.patience <= 0:
            kind = "hopeless"
        elif start < SIXTEEN:
            kind = "file header"
        elif kind == "ends":
            kind = "cut off" if end is None else "length"
        end = len(data) if end is None else end
        self.damages.append({"offset": start, "bytes": end - start, "kind": kind})
        return end

    def entries(self):
        """The index, made anew."""
        entries = []
        for offset, _, frame in self.records:
            entry = {"offset": offset, "type": frame.type}
            try:
                if frame.type == KEYFRAME:
                    body = Body(frame.payload)
                    entries.append(entry | {"time": body.time, "frame": body.frame})
                elif frame.type in (SCENE, EDIT):
                    told = read_message(frame.type, frame.payload)
                    if frame.type == EDIT or told["choice"] == 0:
                        entries.append(entry)
            except Refused:
                continue
        return entries

    def repaired(self):
        """What parity makes whole again, in the order of the file."""
        data, repaired = bytearray(self.data), []
        for _ in range(PASSES):
            file, seen, before = Recording(bytes(data)), set(), len(repaired)
            for offset, _, frame in file.records if file.damages else []:
                stretch = parity_stretch(frame.payload, offset) if frame.type == PARITY else None
                if stretch and stretch[0] not in seen:
                    seen.add(stretch[0])
                    repair(data, frame.payload, repaired, *stretch)
            if len(repaired) == before:
                break
        return sorted(repaired, key=lambda stretch: stretch["offset"])

    def report(self):
        told, index, close = self.entries(), "none", None
        records = []
        for offset, arrival, frame in self.records:
            place = {"type": frame.type, "group": frame.group, "sequence": frame.sequence}
            records.append({"offset": offset, "arrival": arrival, "length": frame.length} | place)
            if frame.type == INDEX:
                index = "agrees" if read_index(frame.payload) == told else "differs"
            elif frame.type == CLOSE:
                try:
                    close = read_message(CLOSE, frame.payload)["code"]
                except Refused:
                    close = None
        parts = {"records": records, "damages": self.damages, "repaired": self.repaired()}
        return parts | {"entries": told, "index": index, "close": close}


def chunk_bytes(length):
    """The chunk of a stretch: 1/128 of it, rounded up to a power of two, 64 to 1,024."""
    chunk = 64
    while chunk < 1024 and chunk * 128 < length:
        chunk *= 2
    return chunk


def parity_stretch(payload, offset):
    """Start, length and chunk of what the parity record at `offset` covers; None when it is no parity."""
    if len(payload) < SIXTEEN:
        return None
    start, length, chunk = number(payload, 0, 8), number(payload, 8, 4), number(payload, 12, 4)
    if start % COVERED or not 1 <= length <= COVERED or start + length > offset:
        return None
    size = SIXTEEN + 4 * -(-length // chunk_bytes(length)) + 2 * chunk_bytes(length)
    return (start, length, chunk) if chunk == chunk_bytes(length) and len(payload) == size else None


def repair(data, payload, repaired, start, length, chunk):
    """Repairs what a parity payload covers, one chunk with an even number and one with an odd."""
    count = -(-length // chunk)
    chunks = [data[start + chunk * n : start + min(chunk * n + chunk, length)] for n in range(count)]
    sums = [number(payload, SIXTEEN + 4 * n, 4) for n in range(count)]
    bad = [n for n in range(count) if crc32c(bytes(chunks[n])) != sums[n]]
    for parity in range(2):
        wrong = [n for n in bad if n % 2 == parity]
        if len(wrong) != 1 or count < parity + 3:
            continue
        n, at = wrong[0], SIXTEEN + 4 * count + chunk * parity
        whole = bytearray(byte ^ 0xFF for byte in payload[at : at + chunk])
        for other in range(parity, count, 2):
            if other != n:
                for place, byte in enumerate(chunks[other]):
                    whole[place] ^= byte
        whole = whole[: len(chunks[n])]
        if crc32c(bytes(whole)) == sums[n]:
            differ = [place for place, byte in enumerate(chunks[n]) if byte != whole[place]]
            first = start + chunk * n
            repaired.append({"offset": first + differ[0], "bytes": differ[-1] - differ[0] + 1})
            data[first : first + len(whole)] = whole


def read_index(payload):
    """The entries of an INDEX frame; None when it is not one."""
    if len(payload) % ENTRY:
        return None
    entries = []
    for at in range(0, len(payload), ENTRY):
        kind, time, frame = payload[at + 20], number(payload, at + 8, 8), number(payload, at + 16, 4)
        if kind not in (SCENE, EDIT, KEYFRAME) or any(payload[at + 21 : at + ENTRY]):
            return None
        entry = {"offset": number(payload, at, 8), "type": kind}
        if kind == KEYFRAME:
            entry |= {"time": time, "frame": frame}
        elif time or frame:
            return None
        entries.append(entry)
    return entries
