//! Elimination in one stretch of points, beside others that do the same.

use std::cmp::Reverse;
use std::ops::Range;

use super::Key;
use super::grid::{Link, Links};

/// How many points one stands for where they are counted.
const SAMPLE: usize = 4;

/// Where a region hears of a ghost: the ghost's own region, and its place among that one's exported.
#[derive(Clone, Copy)]
struct GhostSource {
    region: u32,
    place: u32,
}

/// Neighbours in two regions, by the grid's numbers, `from` the lower one.
#[derive(Clone, Copy)]
pub(super) struct CrossLink {
    pub(super) from: u32,
    pub(super) to: u32,
    weight: f32,
}

impl CrossLink {
    /// Those of the points `own` with points after them, out of all links to points ahead.
    pub(super) fn out_of(own: Range<u32>, ahead: &Links) -> impl Iterator<Item = Self> {
        let end = own.end;
        own.enumerate().flat_map(move |(index, from)| {
            let out = ahead.of(index).iter().filter(move |link| link.to >= end);
            out.map(move |link| Self { from, to: link.to, weight: link.weight })
        })
    }
}

/// A stretch of points and, as ghosts, those of other regions that are within reach of one of them. It numbers both
/// together in the grid's order: ghosts before its own points, its own, ghosts after them.
pub(super) struct Region {
    /// The grid's numbers of its own points.
    own: Range<u32>,
    /// Number of its first own point.
    first: u32,
    /// The grid's numbers of the ghosts, ascending.
    ghosts: Vec<u32>,
    sources: Vec<GhostSource>,
    /// Its own points that are ghosts elsewhere.
    exported: Vec<u32>,
    /// Neighbours of its own points.
    neighbours: Neighbours,
    /// Its own points that are neighbours of each ghost.
    ghost_links: Links,
    weights: Weights,
    /// Its own points that cannot go before a ghost does.
    blocked: Vec<u32>,
    /// Its own points that are removed, by the grid's numbers.
    removed: Vec<Key>,
    /// Links looked at so far.
    link_visits: usize,
    // Room that is used again.
    ascent: Vec<u32>,
    removed_links: Vec<(Key, f32)>,
}

impl Region {
    /// Returns the points `own`. `ahead` links them to their neighbours with higher numbers, `behind` to those with
    /// lower ones that are not their own, ordered by the higher number and then the lower; all by the grid's numbers.
    pub(super) fn new(own: Range<u32>, mut ahead: Links, behind: &[CrossLink]) -> Self {
        let count = own.len() as u32;
        let mut ghosts = sorted(behind.iter().map(|link| link.from));
        let first = ghosts.len() as u32;
        ghosts.extend(sorted(ahead.list.iter().map(|link| link.to).filter(|&to| to >= own.end)));
        let ghost = |number| ghosts.partition_point(|&ghost| ghost < number) as u32;
        let mut visits = Vec::new();
        let mut back = BackLinks::new(&own, &ahead, behind);
        for link in behind {
            let (index, ghost) = (link.to - own.start, ghost(link.from));
            back.add(index, Link { to: ghost, weight: link.weight });
            visits.push((ghost, Link { to: index + first, weight: link.weight }));
        }
        let mut weights = Weights::new(first, count, ghosts.len() as u32);
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
                    let ghost = ghost(link.to);
                    visits.push((ghost, Link { to: point, weight: link.weight }));
                    link.to = ghost + count;
                }
            }
            weights.keys[point as usize] = Key::new(total, point);
        }
        Self {
            exported: sorted(visits.iter().map(|(_, link)| link.to)),
            ghost_links: Links::collect(ghosts.len(), visits),
            neighbours: Neighbours { behind: back.links, ahead },
            sources: Vec::new(),
            blocked: Vec::new(),
            removed: Vec::new(),
            link_visits: 0,
            ascent: Vec::new(),
            removed_links: Vec::new(),
            weights,
            own,
            first,
            ghosts,
        }
    }

    /// Introduces all regions to each other.
    pub(super) fn connect_ghosts(regions: &mut [Self]) {
        let ends: Vec<u32> = regions.iter().map(|region| region.own.end).collect();
        let sources: Vec<Vec<GhostSource>> = regions
            .iter()
            .map(|region| {
                let source = |&ghost| {
                    let region = ends.partition_point(|&end| end <= ghost);
                    let home: &Self = &regions[region];
                    let number = ghost - home.own.start + home.first;
                    let place = home.exported.partition_point(|&point| point < number);
                    GhostSource { region: region as u32, place: place as u32 }
                };
                region.ghosts.iter().map(source).collect()
            })
            .collect();
        for (region, sources) in regions.iter_mut().zip(sources) {
            region.sources = sources;
        }
    }

    /// What other regions import_keys of this one's points: their keys.
    pub(super) fn export_keys(&self) -> Vec<Key> {
        self.exported.iter().map(|&point| self.weights.keys[point as usize]).collect()
    }

    /// Takes in what all regions exchange_keys of their points.
    pub(super) fn import_keys(&mut self, exported_keys: &[Vec<Key>]) {
        for (index, source) in self.sources.iter().enumerate() {
            let ghost = index as u32 + if (index as u32) < self.first { 0 } else { self.own.len() as u32 };
            let key = &mut self.weights.keys[ghost as usize];
            if key.is_removed() {
                continue;
            }
            *key = exported_keys[source.region as usize][source.place as usize].of(ghost);
            if key.is_removed() {
                let key_at_removal = key.key_at_removal();
                for link in self.ghost_links.of(index) {
                    self.weights.subtract_weight(link.to, key_at_removal, link.weight);
                }
            }
        }
    }

    /// Counts its own points that are left by class of weight, every [`SAMPLE`]th for all.
    pub(super) fn count_classes(&self, classes: &mut [usize]) {
        let own = &self.weights.keys[self.first as usize..][..self.own.len()];
        for key in own.iter().step_by(SAMPLE).filter(|key| !key.is_removed()) {
            classes[key.class()] += SAMPLE;
        }
    }

    /// Returns its own points that are removed.
    pub(super) fn removed(&self) -> &[Key] {
        &self.removed
    }

    /// Returns the links of its own points.
    pub(super) fn links(&self) -> usize {
        self.neighbours.behind.list.len() + self.neighbours.ahead.list.len()
    }

    /// How many links it has looked at to find points that go.
    pub(super) fn link_visits(&self) -> usize {
        self.link_visits
    }

    /// Returns whether some of its points wait for others.
    pub(super) fn is_blocked(&self) -> bool {
        !self.blocked.is_empty()
    }

    /// Lets go all of its own points that recompute_weight `threshold` or more, but for those that wait for a ghost.
    pub(super) fn sweep(&mut self, threshold: Key) {
        for point in self.first..self.first + self.own.len() as u32 {
            self.eliminate_around(point, threshold);
        }
    }

    /// As [`Region::sweep`], for those that waited.
    pub(super) fn retry(&mut self, threshold: Key) {
        for point in std::mem::take(&mut self.blocked) {
            self.eliminate_around(point, threshold);
        }
    }

    /// Climbs from `point` along heaviest neighbours to a local maximum, removes it, and repeats until `point` itself is
    /// removed or below the threshold.
    fn eliminate_around(&mut self, point: u32, threshold: Key) {
        self.ascent.push(point);
        while let Some(&top) = self.ascent.last() {
            let mut own = self.weights.keys[top as usize];
            if own >= threshold && self.weights.is_stale(top) {
                own = self.recompute_weight(top);
            }
            if own < threshold {
                self.ascent.pop();
                continue;
            }
            let mut heaviest = own;
            for links in self.neighbours.of(top - self.first) {
                self.link_visits += links.len();
                for link in links {
                    heaviest = heaviest.max(self.weights.keys[link.to as usize]);
                }
            }
            if heaviest == own {
                self.ascent.pop();
                self.remove(own);
            } else if self.weights.is_own(heaviest.point()) {
                self.ascent.push(heaviest.point());
            } else {
                self.ascent.clear();
                self.blocked.push(point);
            }
        }
    }

    fn remove(&mut self, key: Key) {
        let point = key.point();
        self.weights.keys[point as usize] = key.removed();
        self.removed.push(key.of(point - self.first + self.own.start));
        for links in self.neighbours.of(point - self.first) {
            for link in links {
                if self.weights.is_own(link.to) {
                    self.weights.subtract_weight(link.to, key, link.weight);
                }
            }
        }
    }

    /// Weighs one of its own points without the neighbours that are removed, removed_links off in the order in which they go one by
    /// one: the sum depends on it.
    fn recompute_weight(&mut self, point: u32) -> Key {
        self.removed_links.clear();
        let mut weight = 0.0;
        for links in self.neighbours.of(point - self.first) {
            for link in links {
                weight += link.weight;
                let key = self.weights.keys[link.to as usize];
                if key.is_removed() {
                    self.removed_links.push((key.key_at_removal(), link.weight));
                }
            }
        }
        self.removed_links.sort_unstable_by_key(|&(key, _)| Reverse(key));
        for (_, removed) in &self.removed_links {
            weight -= removed;
        }
        let last_removed = self.removed_links.last().map_or(Key::FIRST, |&(key, _)| key);
        self.weights.set(Key::new(weight, point), last_removed)
    }
}

/// Neighbours of a region's own points.
struct Neighbours {
    /// Those with lower numbers.
    behind: Links,
    /// Those with higher numbers.
    ahead: Links,
}

impl Neighbours {
    /// Returns the neighbours of an own point, ascending in two parts.
    fn of(&self, index: u32) -> [&[Link]; 2] {
        [self.behind.of(index as usize), self.ahead.of(index as usize)]
    }
}

/// What a region's points recompute_weight.
struct Weights {
    first: u32,
    /// What points recompute_weight, or more than that; of those that are removed, what they weighed when they went.
    keys: Vec<Key>,
    /// The last neighbour of each own point to go; [`Key::NONE`] where the point is to be weighed again.
    last_removed: Vec<Key>,
}

impl Weights {
    /// Of `count` own points from `first` on and some ghosts, heavier than anything until more is known.
    fn new(first: u32, count: u32, ghosts: u32) -> Self {
        let keys = (0..count + ghosts).map(|point| Key::new(f32::INFINITY, point)).collect();
        Self { first, keys, last_removed: vec![Key::FIRST; count as usize] }
    }

    fn is_own(&self, point: u32) -> bool {
        (point.wrapping_sub(self.first) as usize) < self.last_removed.len()
    }

    /// Returns whether an own point is to be weighed again.
    fn is_stale(&self, point: u32) -> bool {
        self.last_removed[(point - self.first) as usize] == Key::NONE
    }

    /// What an own point weighs, without neighbours up to `last_removed`.
    fn set(&mut self, key: Key, last_removed: Key) -> Key {
        self.keys[key.point() as usize] = key;
        self.last_removed[(key.point() - self.first) as usize] = last_removed;
        key
    }

    /// Takes the weight of a neighbour that is removed off an own point. Where neighbours go in another order than they
    /// would one by one, the point keeps its weight, which is too high then, until it is weighed again.
    fn subtract_weight(&mut self, point: u32, removed: Key, by: f32) {
        let key = &mut self.keys[point as usize];
        if key.is_removed() {
            return;
        }
        let last_removed = &mut self.last_removed[(point - self.first) as usize];
        if removed < *last_removed {
            *last_removed = removed;
            *key = Key::new(key.weight() - by, point);
        } else {
            *last_removed = Key::NONE;
        }
    }
}

/// Links back to points with lower numbers, as they are put together.
struct BackLinks {
    links: Links,
    /// Where the next one of each point goes, and the weights so far.
    next: Vec<(u32, f32)>,
}

impl BackLinks {
    /// Makes room.
    fn new(own: &Range<u32>, ahead: &Links, behind: &[CrossLink]) -> Self {
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

/// Returns the numbers ascending, each once.
fn sorted(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut numbers: Vec<u32> = numbers.collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}
