//! Elimination in one stretch of points, beside others that do the same.

use std::cmp::Reverse;
use std::ops::Range;

use super::Key;
use super::grid::{Link, Links};

/// How many points one stands for where they are counted.
const SAMPLE: usize = 4;

/// How a point stands, as its region tells the others.
#[derive(Clone, Copy)]
pub(super) struct Standing {
    /// What it weighs; [`Key::GONE`] once it is gone.
    key: Key,
    /// What it weighed when it went.
    parting: Key,
}

/// Where a region hears of a guest: the guest's own region, and its place among that one's hosts.
#[derive(Clone, Copy)]
struct Source {
    region: u32,
    place: u32,
}

/// Neighbours in two regions, by the grid's numbers, `from` the lower one.
#[derive(Clone, Copy)]
pub(super) struct Crossing {
    pub(super) from: u32,
    pub(super) to: u32,
    weight: f32,
}

impl Crossing {
    /// Those of the points `own` with points after them, out of all links to points ahead.
    pub(super) fn out_of(own: Range<u32>, ahead: &Links) -> impl Iterator<Item = Self> {
        let end = own.end;
        own.enumerate().flat_map(move |(index, from)| {
            let out = ahead.of(index).iter().filter(move |link| link.to >= end);
            out.map(move |link| Self { from, to: link.to, weight: link.weight })
        })
    }
}

/// A stretch of points and, as guests, those of other regions that are within reach of one of them. It numbers both
/// together in the grid's order: guests before its own points, its own, guests after them.
pub(super) struct Region {
    /// The grid's numbers of its own points.
    own: Range<u32>,
    /// Number of its first own point.
    first: u32,
    /// The grid's numbers of the guests, ascending.
    guests: Vec<u32>,
    sources: Vec<Source>,
    /// Its own points that are guests elsewhere.
    hosts: Vec<u32>,
    /// Neighbours of its own points.
    links: Links,
    /// Its own points that are neighbours of each guest.
    guest_links: Links,
    /// What points weigh, or more than that; [`Key::GONE`] once they are gone.
    keys: Vec<Key>,
    /// What points weighed when they went.
    partings: Vec<Key>,
    /// The last neighbour of each of its own points to go; [`Key::GONE`] where the point is to be weighed again.
    latest: Vec<Key>,
    /// Its own points that cannot go before a guest does.
    blocked: Vec<u32>,
    /// Its own points that are gone, by the grid's numbers.
    gone: Vec<Key>,
    /// Links looked at so far.
    looks: usize,
    // Room that is used again.
    ascent: Vec<u32>,
    taken: Vec<(Key, f32)>,
}

impl Region {
    /// The points `own`. `ahead` links them to their neighbours with higher numbers, `behind` to those with lower ones
    /// that are not their own, ordered by the higher number and then the lower; all by the grid's numbers.
    pub(super) fn new(own: Range<u32>, ahead: &Links, behind: &[Crossing]) -> Self {
        let count = own.len();
        let mut guests = sorted(behind.iter().map(|link| link.from));
        let first = guests.len() as u32;
        guests.extend(sorted(ahead.list.iter().map(|link| link.to).filter(|&to| to >= own.end)));
        let guest = |number| guests.partition_point(|&guest| guest < number) as u32;
        let mut rows = Rows::new(&own, ahead, behind);
        let mut visits = Vec::new();
        for link in behind {
            let (index, guest) = (link.to - own.start, guest(link.from));
            rows.add(index, Link { to: guest, weight: link.weight });
            visits.push((guest, Link { to: index + first, weight: link.weight }));
        }
        // In this order every row is ascending.
        for index in 0..count as u32 {
            for &Link { to, weight } in ahead.of(index as usize) {
                if to < own.end {
                    rows.add(index, Link { to: to - own.start + first, weight });
                    rows.add(to - own.start, Link { to: index + first, weight });
                } else {
                    let guest = guest(to);
                    rows.add(index, Link { to: guest + count as u32, weight });
                    visits.push((guest, Link { to: index + first, weight }));
                }
            }
        }
        let links = rows.links;
        let mut keys: Vec<Key> =
            (0..(guests.len() + count) as u32).map(|point| Key::new(f32::INFINITY, point)).collect();
        for ((_, total), key) in rows.next.into_iter().zip(&mut keys[first as usize..]) {
            *key = Key::new(total, key.point());
        }
        Self {
            hosts: sorted(visits.iter().map(|(_, link)| link.to)),
            guest_links: Links::collect(guests.len(), visits),
            keys,
            partings: vec![Key::GONE; guests.len() + count],
            latest: vec![Key::FIRST; count],
            sources: Vec::new(),
            blocked: Vec::new(),
            gone: Vec::new(),
            looks: 0,
            ascent: Vec::new(),
            taken: Vec::new(),
            own,
            first,
            guests,
            links,
        }
    }

    /// Introduces all regions to each other.
    pub(super) fn introduce(regions: &mut [Self]) {
        let ends: Vec<u32> = regions.iter().map(|region| region.own.end).collect();
        let sources: Vec<Vec<Source>> = regions
            .iter()
            .map(|region| {
                let source = |&guest| {
                    let region = ends.partition_point(|&end| end <= guest);
                    let home: &Self = &regions[region];
                    let number = guest - home.own.start + home.first;
                    let place = home.hosts.partition_point(|&host| host < number);
                    Source { region: region as u32, place: place as u32 }
                };
                region.guests.iter().map(source).collect()
            })
            .collect();
        for (region, sources) in regions.iter_mut().zip(sources) {
            region.sources = sources;
        }
    }

    /// What other regions hear of this one's points.
    pub(super) fn tell(&self) -> Vec<Standing> {
        let stands =
            |&host| Standing { key: self.keys[host as usize], parting: self.partings[host as usize] };
        self.hosts.iter().map(stands).collect()
    }

    /// Takes in what all regions tell of their points.
    pub(super) fn hear(&mut self, told: &[Vec<Standing>]) {
        for index in 0..self.guests.len() {
            let source = self.sources[index];
            let standing = told[source.region as usize][source.place as usize];
            let guest = if (index as u32) < self.first { index } else { index + self.own.len() };
            if self.keys[guest] == Key::GONE {
                continue;
            }
            if standing.key == Key::GONE {
                let parting = Key::new(standing.parting.weight(), guest as u32);
                self.keys[guest] = Key::GONE;
                self.partings[guest] = parting;
                for at in self.guest_links.range(index) {
                    let Link { to, weight } = self.guest_links.list[at];
                    self.lighten(to, parting, weight);
                }
            } else {
                self.keys[guest] = Key::new(standing.key.weight(), guest as u32);
            }
        }
    }

    /// Counts its own points that are left by class of weight, every [`SAMPLE`]th for all.
    pub(super) fn census(&self, classes: &mut [usize]) {
        let own = &self.keys[self.first as usize..][..self.own.len()];
        for key in own.iter().step_by(SAMPLE).filter(|&&key| key != Key::GONE) {
            classes[key.class()] += SAMPLE;
        }
    }

    /// Its own points that are gone.
    pub(super) fn gone(&self) -> &[Key] {
        &self.gone
    }

    /// Links of its own points.
    pub(super) fn links(&self) -> usize {
        self.links.list.len()
    }

    /// How many links it has looked at to find points that go.
    pub(super) fn looks(&self) -> usize {
        self.looks
    }

    /// Whether some of its points wait for others.
    pub(super) fn is_blocked(&self) -> bool {
        !self.blocked.is_empty()
    }

    /// Lets go all of its own points that weigh `least` or more, but for those that wait for a guest.
    pub(super) fn sweep(&mut self, least: Key) {
        for point in self.first..self.first + self.own.len() as u32 {
            self.settle(point, least);
        }
    }

    /// As [`Region::sweep`], for those that waited.
    pub(super) fn retry(&mut self, least: Key) {
        for point in std::mem::take(&mut self.blocked) {
            self.settle(point, least);
        }
    }

    /// Goes from `point` to its heaviest neighbour and on from there up to one that is heavier than all of its own, lets
    /// that one go, and starts over, until the point is gone or light.
    fn settle(&mut self, point: u32, least: Key) {
        self.ascent.push(point);
        while let Some(&top) = self.ascent.last() {
            let mut own = self.keys[top as usize];
            if own >= least && self.latest[(top - self.first) as usize] == Key::GONE {
                own = self.weigh(top);
            }
            if own < least {
                self.ascent.pop();
                continue;
            }
            let links = self.links.of((top - self.first) as usize);
            self.looks += links.len();
            let mut heaviest = own;
            for link in links {
                heaviest = heaviest.max(self.keys[link.to as usize]);
            }
            if heaviest == own {
                self.ascent.pop();
                self.remove(own);
            } else if self.is_own(heaviest.point()) {
                self.ascent.push(heaviest.point());
            } else {
                self.ascent.clear();
                self.blocked.push(point);
            }
        }
    }

    fn is_own(&self, point: u32) -> bool {
        (self.first..self.first + self.own.len() as u32).contains(&point)
    }

    fn remove(&mut self, key: Key) {
        let point = key.point() as usize;
        self.partings[point] = key;
        self.keys[point] = Key::GONE;
        self.gone.push(Key::new(key.weight(), key.point() - self.first + self.own.start));
        for at in self.links.range(point - self.first as usize) {
            let Link { to, weight } = self.links.list[at];
            if self.is_own(to) {
                self.lighten(to, key, weight);
            }
        }
    }

    /// Takes the weight of a neighbour that is gone off one of its own points. Where neighbours go in another order than
    /// they would one by one, the point keeps its weight, which is too high then, until it is weighed again.
    fn lighten(&mut self, point: u32, gone: Key, by: f32) {
        let key = self.keys[point as usize];
        if key == Key::GONE {
            return;
        }
        let latest = &mut self.latest[(point - self.first) as usize];
        if gone < *latest {
            *latest = gone;
            self.keys[point as usize] = Key::new(key.weight() - by, point);
        } else {
            *latest = Key::GONE;
        }
    }

    /// Weighs one of its own points without the neighbours that are gone, taken off in the order in which they go one by
    /// one: the sum depends on it.
    fn weigh(&mut self, point: u32) -> Key {
        let index = (point - self.first) as usize;
        self.taken.clear();
        let mut weight = 0.0;
        for link in self.links.of(index) {
            weight += link.weight;
            if self.keys[link.to as usize] == Key::GONE {
                self.taken.push((self.partings[link.to as usize], link.weight));
            }
        }
        self.taken.sort_unstable_by_key(|&(key, _)| Reverse(key));
        for (_, gone) in &self.taken {
            weight -= gone;
        }
        self.latest[index] = self.taken.last().map_or(Key::FIRST, |&(key, _)| key);
        self.keys[point as usize] = Key::new(weight, point);
        self.keys[point as usize]
    }
}

/// Neighbours of a region's own points, as they are put together.
struct Rows {
    links: Links,
    /// Where the next neighbour of each point goes, and the weights so far.
    next: Vec<(u32, f32)>,
}

impl Rows {
    /// Makes room.
    fn new(own: &Range<u32>, ahead: &Links, behind: &[Crossing]) -> Self {
        let mut starts = vec![0; own.len() + 1];
        for (index, pair) in ahead.starts.windows(2).enumerate() {
            starts[index + 1] += pair[1] - pair[0];
        }
        let inside = ahead.list.iter().map(|link| link.to).filter(|&to| to < own.end);
        for to in inside.chain(behind.iter().map(|link| link.to)) {
            starts[(to - own.start) as usize + 1] += 1;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let next = starts[..own.len()].iter().map(|&start| (start, 0.0)).collect();
        Self { links: Links { starts, list: vec![Link::default(); sum as usize] }, next }
    }

    /// Adds a neighbour of the point at `index`, with a higher number than the ones before.
    fn add(&mut self, index: u32, link: Link) {
        let (next, total) = &mut self.next[index as usize];
        self.links.list[*next as usize] = link;
        *next += 1;
        *total += link.weight;
    }
}

/// Numbers ascending, each once.
fn sorted(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut numbers: Vec<u32> = numbers.collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}
