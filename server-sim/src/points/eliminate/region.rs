//! Elimination in one stretch of points, beside others that do the same.

use std::cmp::Reverse;
use std::ops::Range;

use super::Key;
use super::grid::{Link, Links};

/// How many points one stands for where they are counted.
const SAMPLE: usize = 4;

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
    web: Web,
    /// Its own points that are neighbours of each guest.
    guest_links: Links,
    scales: Scales,
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
    pub(super) fn new(own: Range<u32>, mut ahead: Links, behind: &[Crossing]) -> Self {
        let count = own.len() as u32;
        let mut guests = sorted(behind.iter().map(|link| link.from));
        let first = guests.len() as u32;
        guests.extend(sorted(ahead.list.iter().map(|link| link.to).filter(|&to| to >= own.end)));
        let guest = |number| guests.partition_point(|&guest| guest < number) as u32;
        let mut visits = Vec::new();
        let mut back = Back::new(&own, &ahead, behind);
        for link in behind {
            let (index, guest) = (link.to - own.start, guest(link.from));
            back.add(index, Link { to: guest, weight: link.weight });
            visits.push((guest, Link { to: index + first, weight: link.weight }));
        }
        let mut scales = Scales::new(first, count, guests.len() as u32);
        // In this order, all links back to points with lower numbers are there, and weights add up in one order.
        for point in first..first + count {
            let index = point - first;
            let mut total = back.next[index as usize].1;
            let range = ahead.range(index as usize);
            for link in &mut ahead.list[range] {
                total += link.weight;
                if link.to < own.end {
                    let to = link.to - own.start;
                    back.add(to, Link { to: point, weight: link.weight });
                    link.to = to + first;
                } else {
                    let guest = guest(link.to);
                    visits.push((guest, Link { to: point, weight: link.weight }));
                    link.to = guest + count;
                }
            }
            scales.keys[point as usize] = Key::new(total, point);
        }
        Self {
            hosts: sorted(visits.iter().map(|(_, link)| link.to)),
            guest_links: Links::collect(guests.len(), visits),
            web: Web { behind: back.links, ahead },
            sources: Vec::new(),
            blocked: Vec::new(),
            gone: Vec::new(),
            looks: 0,
            ascent: Vec::new(),
            taken: Vec::new(),
            scales,
            own,
            first,
            guests,
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

    /// What other regions hear of this one's points: their keys.
    pub(super) fn tell(&self) -> Vec<Key> {
        self.hosts.iter().map(|&host| self.scales.keys[host as usize]).collect()
    }

    /// Takes in what all regions tell of their points.
    pub(super) fn hear(&mut self, told: &[Vec<Key>]) {
        for (index, source) in self.sources.iter().enumerate() {
            let guest = index as u32 + if (index as u32) < self.first { 0 } else { self.own.len() as u32 };
            let key = &mut self.scales.keys[guest as usize];
            if key.is_gone() {
                continue;
            }
            *key = told[source.region as usize][source.place as usize].of(guest);
            if key.is_gone() {
                let parting = key.parting();
                for link in self.guest_links.of(index) {
                    self.scales.lighten(link.to, parting, link.weight);
                }
            }
        }
    }

    /// Counts its own points that are left by class of weight, every [`SAMPLE`]th for all.
    pub(super) fn census(&self, classes: &mut [usize]) {
        let own = &self.scales.keys[self.first as usize..][..self.own.len()];
        for key in own.iter().step_by(SAMPLE).filter(|key| !key.is_gone()) {
            classes[key.class()] += SAMPLE;
        }
    }

    /// Its own points that are gone.
    pub(super) fn gone(&self) -> &[Key] {
        &self.gone
    }

    /// Links of its own points.
    pub(super) fn links(&self) -> usize {
        self.web.behind.list.len() + self.web.ahead.list.len()
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

    /// Climbs from `point` along heaviest neighbours to a local maximum, removes it, and repeats until `point` itself is
    /// removed or below the threshold.
    fn settle(&mut self, point: u32, least: Key) {
        self.ascent.push(point);
        while let Some(&top) = self.ascent.last() {
            let mut own = self.scales.keys[top as usize];
            if own >= least && self.scales.is_stale(top) {
                own = self.weigh(top);
            }
            if own < least {
                self.ascent.pop();
                continue;
            }
            let mut heaviest = own;
            for links in self.web.of(top - self.first) {
                self.looks += links.len();
                for link in links {
                    heaviest = heaviest.max(self.scales.keys[link.to as usize]);
                }
            }
            if heaviest == own {
                self.ascent.pop();
                self.remove(own);
            } else if self.scales.is_own(heaviest.point()) {
                self.ascent.push(heaviest.point());
            } else {
                self.ascent.clear();
                self.blocked.push(point);
            }
        }
    }

    fn remove(&mut self, key: Key) {
        let point = key.point();
        self.scales.keys[point as usize] = key.gone();
        self.gone.push(key.of(point - self.first + self.own.start));
        for links in self.web.of(point - self.first) {
            for link in links {
                if self.scales.is_own(link.to) {
                    self.scales.lighten(link.to, key, link.weight);
                }
            }
        }
    }

    /// Weighs one of its own points without the neighbours that are gone, taken off in the order in which they go one by
    /// one: the sum depends on it.
    fn weigh(&mut self, point: u32) -> Key {
        self.taken.clear();
        let mut weight = 0.0;
        for links in self.web.of(point - self.first) {
            for link in links {
                weight += link.weight;
                let key = self.scales.keys[link.to as usize];
                if key.is_gone() {
                    self.taken.push((key.parting(), link.weight));
                }
            }
        }
        self.taken.sort_unstable_by_key(|&(key, _)| Reverse(key));
        for (_, gone) in &self.taken {
            weight -= gone;
        }
        let latest = self.taken.last().map_or(Key::FIRST, |&(key, _)| key);
        self.scales.set(Key::new(weight, point), latest)
    }
}

/// Neighbours of a region's own points.
struct Web {
    /// Those with lower numbers.
    behind: Links,
    /// Those with higher numbers.
    ahead: Links,
}

impl Web {
    /// Neighbours of an own point, ascending in two parts.
    fn of(&self, index: u32) -> [&[Link]; 2] {
        [self.behind.of(index as usize), self.ahead.of(index as usize)]
    }
}

/// What a region's points weigh.
struct Scales {
    first: u32,
    /// What points weigh, or more than that; of those that are gone, what they weighed when they went.
    keys: Vec<Key>,
    /// The last neighbour of each own point to go; [`Key::NONE`] where the point is to be weighed again.
    latest: Vec<Key>,
}

impl Scales {
    /// Of `count` own points from `first` on and some guests, heavier than anything until more is known.
    fn new(first: u32, count: u32, guests: u32) -> Self {
        let keys = (0..count + guests).map(|point| Key::new(f32::INFINITY, point)).collect();
        Self { first, keys, latest: vec![Key::FIRST; count as usize] }
    }

    fn is_own(&self, point: u32) -> bool {
        (point.wrapping_sub(self.first) as usize) < self.latest.len()
    }

    /// Whether an own point is to be weighed again.
    fn is_stale(&self, point: u32) -> bool {
        self.latest[(point - self.first) as usize] == Key::NONE
    }

    /// What an own point weighs, without neighbours up to `latest`.
    fn set(&mut self, key: Key, latest: Key) -> Key {
        self.keys[key.point() as usize] = key;
        self.latest[(key.point() - self.first) as usize] = latest;
        key
    }

    /// Takes the weight of a neighbour that is gone off an own point. Where neighbours go in another order than they
    /// would one by one, the point keeps its weight, which is too high then, until it is weighed again.
    fn lighten(&mut self, point: u32, gone: Key, by: f32) {
        let key = &mut self.keys[point as usize];
        if key.is_gone() {
            return;
        }
        let latest = &mut self.latest[(point - self.first) as usize];
        if gone < *latest {
            *latest = gone;
            *key = Key::new(key.weight() - by, point);
        } else {
            *latest = Key::NONE;
        }
    }
}

/// Links back to points with lower numbers, as they are put together.
struct Back {
    links: Links,
    /// Where the next one of each point goes, and the weights so far.
    next: Vec<(u32, f32)>,
}

impl Back {
    /// Makes room.
    fn new(own: &Range<u32>, ahead: &Links, behind: &[Crossing]) -> Self {
        let mut starts = vec![0; own.len() + 1];
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

    /// Adds a link of the own point at `index`, to a higher number than those before.
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
