"""The scene table: docs/spec/protocol.md, "SCENE", and how its parts must fit each other."""

from .frame import Frame
from .messages import read_message
from .numbers import must

SCENE = 4
PAPER, SURFACE = 1, 2
INFO, INSTANCES, SETS, MEMBERS = range(4)
MOST_INSTANCES, MOST_BUCKETS, MOST_CELLS, MOST_POINTS = 65_536, 1 << 22, 1 << 22, 1 << 26


class Table:
    """Puts a table together from SCENE messages."""

    def __init__(self):
        self.info, self.lists = None, {INSTANCES: [], SETS: [], MEMBERS: []}

    def take(self, message):
        if message["choice"] == INFO:
            must(self.info is None, "order")
            self.begin(message)
        else:
            must(self.info is not None, "order")
            self.extend(message)
        if self.is_whole():
            self.check()

    def begin(self, info):
        surface = info["profile"] == SURFACE
        must(info["instances"] <= MOST_INSTANCES, "count")
        must(info["sets"] <= (MOST_INSTANCES if surface else 0), "count")
        must(info["profile"] in (PAPER, SURFACE), "profile")
        self.info = info

    def extend(self, batch):
        choice, most = batch["choice"], self.info["instances"]
        if self.info["profile"] == PAPER:
            must(choice == INSTANCES, "order")
        elif choice == SETS:
            must(not self.lists[MEMBERS], "order")
            most = self.info["sets"]
        else:
            must(choice == MEMBERS and len(self.lists[SETS]) == self.info["sets"], "order")
        entries = self.lists[choice]
        must(batch["first"] == len(entries), "order")
        must(len(entries) + len(batch["entries"]) <= most, "count")
        entries += batch["entries"]

    def instances(self):
        return self.lists[INSTANCES if self.info["profile"] == PAPER else MEMBERS]

    def is_whole(self):
        counts = len(self.instances()), len(self.lists[SETS])
        return self.info is not None and counts == (self.info["instances"], self.info["sets"])

    def check(self):
        if self.info["profile"] == PAPER:
            end = 0
            for instance in self.lists[INSTANCES]:
                must(all(cells <= 1 << 21 for cells in instance["dims"]), "layout")
                must(instance["first_bucket"] == end, "layout")
                end += instance["buckets"]
            must(end <= MOST_BUCKETS and self.info["cells"] <= MOST_CELLS, "layout")
            points = [instance["points"] for instance in self.lists[INSTANCES]]
        else:
            sets = self.lists[SETS]
            must(all(largest < 1 << 21 for entry in sets for largest in entry["extent"]), "layout")
            must(all(coarsest_radius(entry) < 2.0**128 for entry in sets), "layout")
            must(all(member["set"] < len(sets) for member in self.lists[MEMBERS]), "layout")
            points = [sets[member["set"]]["points"] for member in self.lists[MEMBERS]]
            must(sum(points) <= MOST_POINTS and sum(entry["points"] for entry in sets) <= MOST_POINTS, "layout")
        must(sum(points) == self.info["points"], "points")

    def report(self):
        if not self.is_whole():
            return {"table": None}
        points = self.info["points"]
        return {"table": {"instances": len(self.instances()), "sets": len(self.lists[SETS]), "points": points}}


def coarsest_radius(entry):
    """The radius of level 0 of a set."""
    return entry["kernel_radius"] * 2 ** ((entry["levels"] - 1) / 2)


def read_table(data):
    """The table of the SCENE frames in `data`."""
    table = Table()
    while data:
        frame = Frame(data)
        must(frame.type == SCENE, "order")
        table.take(read_message(SCENE, frame.payload))
        data = data[frame.size :]
    return table
