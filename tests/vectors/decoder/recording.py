"""Recordings: docs/spec/recording.md."""

from .body import Body
from .frame import INDEX, KEYFRAME, Frame
from .messages import CLOSE, read_message
from .numbers import Refused, crc32c, must

MAGIC = b"\x89PSAO\r\n\x1a"
FOOTER_MAGIC = (0x1D0AA05E).to_bytes(4, "little")
SIXTEEN, HEAD, ENTRY = 16, 12, 24
SCENE, EDIT, PARITY = 4, 6, 66
COVERED = 131_072
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
        if not self.damages:
            return []
        data, repaired = bytearray(self.data), []
        for _, _, frame in self.records:
            if frame.type == PARITY:
                repair(data, frame.payload, repaired)
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


def repair(data, payload, repaired):
    """Repairs what a parity payload covers, one chunk with an even number and one with an odd."""
    if len(payload) < SIXTEEN:
        return
    start, length, chunk = number(payload, 0, 8), number(payload, 8, 4), number(payload, 12, 4)
    possible = chunk in (64, 128, 256, 512, 1024) and length <= COVERED and start + length <= len(data)
    count = -(-length // chunk) if possible else 0
    if not possible or len(payload) != SIXTEEN + 4 * count + 2 * chunk:
        return
    chunks = [data[start + chunk * n : start + min(chunk * n + chunk, length)] for n in range(count)]
    sums = [number(payload, SIXTEEN + 4 * n, 4) for n in range(count)]
    bad = [n for n in range(count) if crc32c(bytes(chunks[n])) != sums[n]]
    for parity in range(2):
        wrong = [n for n in bad if n % 2 == parity]
        if len(wrong) != 1:
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
