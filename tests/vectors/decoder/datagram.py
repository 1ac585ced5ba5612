"""Datagrams: docs/spec/protocol.md, "Datagrams"."""

from .messages import read_message
from .numbers import Refused, crc32c, must

HEADER = 20
PIECE, ACKNOWLEDGEMENT = 1, 2
ACK = 12
BODY_LIMIT = 1 << 20


class Datagram:
    """A datagram of this protocol. Whatever is not one is refused, which on a network means: dropped and counted."""

    def __init__(self, data):
        must(len(data) >= HEADER, "short")
        number = lambda at, size: int.from_bytes(data[at : at + size], "little")
        must(data[:2] == b"\x51\xa0" and data[3] == 0, "header")
        self.type, self.frame = data[2], number(4, 4)
        self.piece, self.pieces, self.total = number(8, 2), number(10, 2), number(12, 4)
        self.content = data[HEADER:]
        must(number(16, 4) == crc32c(data[:16] + self.content), "checksum")

    def check_piece(self):
        must(self.type == PIECE and self.piece < self.pieces and self.total <= BODY_LIMIT, "piece")
        size = -(-self.total // self.pieces)
        # No piece is empty but that of an empty body.
        must(self.pieces == 1 or size * (self.pieces - 1) < self.total, "piece")
        left = self.total - size * self.piece
        must(len(self.content) == min(size, left), "piece")

    def acknowledged(self):
        """The ACK message of an acknowledgement."""
        must(self.type == ACKNOWLEDGEMENT, "acknowledgement")
        must((self.piece, self.pieces, self.total) == (0, 1, len(self.content)), "acknowledgement")
        message = read_message(ACK, self.content)
        must(message["frame"] == self.frame, "acknowledgement")
        return message


class Joiner:
    """Keeps the pieces of one body, that of the newest frame. `here` is the frame that the receiver has."""

    def __init__(self, here):
        self.here, self.body, self.pieces, self.done = here, None, {}, False

    def take(self, data):
        """What a datagram is good for, and the frame and body that it made whole."""
        try:
            datagram = Datagram(data)
            datagram.check_piece()
        except Refused:
            return "bad", None
        body = (datagram.frame, datagram.pieces, datagram.total)
        newest = max(self.here, self.body[0]) if self.body else self.here
        if datagram.frame < newest or datagram.frame == self.here:
            return "waits", None
        if self.body and datagram.frame == self.body[0]:
            if body != self.body:
                return "bad", None
        else:
            self.body, self.pieces, self.done = body, {}, False
        self.pieces[datagram.piece] = datagram.content
        if self.done or len(self.pieces) < datagram.pieces:
            return "waits", None
        self.done = True
        return "whole", (datagram.frame, b"".join(self.pieces[number] for number in range(datagram.pieces)))
