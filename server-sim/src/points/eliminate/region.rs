//! Elimination in one range of points, in parallel with other ranges.

use std::cmp::Reverse;
use std::ops::Range;

use super::RemovalKey;
use super::grid::{Link, Links};

/// Interval of the points that are sampled for counting.
const SAMPLE: usize = 4;

/// Source of a ghost's key: its own region, and its place among the points that the region exports.
#[derive(Clone, Copy)]
struct GhostSource {
    region: u32,
    place: u32,
}

/// Neighbours in two regions, by the grid's numbers; `from` is the lower one.
#[derive(Clone, Copy)]
pub(super) struct CrossLink {
    pub(super) from: u32,
    pub(super) to: u32,
    weight: f32,
}

impl CrossLink {
    /// Selects the links from the points `own` to later regions out of all links ahead.
    pub(super) fn out_of(own: Range<u32>, ahead: &Links) -> impl Iterator<Item = Self> {
        let end = own.end;
        own.enumerate().flat_map(move |(index, from)| {
            let out = ahead.of(index).iter().filter(move |link| link.to >= end);
            out.map(move |link| Self { from, to: link.to, weight: link.weight })
        })
    }
}

/// A range of points and, as ghosts, the points of other regions within reach of one of them. It numbers both
/// together in the grid's order: earlier ghosts, own points, later ghosts.
pub(super) struct Region {
    /// Grid numbers of its own points.
    own: Range<u32>,
    /// Number of its first own point.
    first: u32,
    /// Grid numbers of the ghosts, ascending.
    ghosts: Vec<u32>,
    sources: Vec<GhostSource>,
    /// Its own points that are ghosts in other regions.
    exported: Vec<u32>,
    /// Neighbours of its own points.
    neighbours: Neighbours,
    /// For each ghost, its neighbours among the own points.
    ghost_links: Links,
    weights: Weights,
    /// Its own points that must wait for the removal of a ghost.
    blocked: Vec<u32>,
    /// Its own removed points, by grid numbers.
    removed: Vec<RemovalKey>,
    /// Number of links visited so far.
    link_visits: usize,
    // Buffers that are reused.
    ascent: Vec<u32>,
    removed_links: Vec<(RemovalKey, f32)>,
}

impl Region {
    /// Creates the region of the points `own`, by grid numbers. `ahead` has their links to neighbours with higher
    /// numbers. `behind` has the links from earlier regions, sorted by the higher and then the lower number.
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
        // This order makes all links to lower numbers available and sums weights in a fixed order.
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
            weights.keys[point as usize] = RemovalKey::new(total, point);
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

    /// Finds the source of every ghost.
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

    /// Returns the keys of the exported points.
    pub(super) fn export_keys(&self) -> Vec<RemovalKey> {
        self.exported.iter().map(|&point| self.weights.keys[point as usize]).collect()
    }

    /// Copies the keys of the ghosts from all exported keys.
    pub(super) fn import_keys(&mut self, exported_keys: &[Vec<RemovalKey>]) {
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

    /// Counts its own remaining points by class of weight, sampling every [`SAMPLE`]th point.
    pub(super) fn count_classes(&self, classes: &mut [usize]) {
        let own = &self.weights.keys[self.first as usize..][..self.own.len()];
        for key in own.iter().step_by(SAMPLE).filter(|key| !key.is_removed()) {
            classes[key.class()] += SAMPLE;
        }
    }

    /// Returns its own removed points.
    pub(super) fn removed(&self) -> &[RemovalKey] {
        &self.removed
    }

    /// Returns the number of links of its own points.
    pub(super) fn links(&self) -> usize {
        self.neighbours.behind.list.len() + self.neighbours.ahead.list.len()
    }

    /// Returns the number of links visited so far.
    pub(super) fn link_visits(&self) -> usize {
        self.link_visits
    }

    /// Returns whether some of its points wait for a ghost.
    pub(super) fn is_blocked(&self) -> bool {
        !self.blocked.is_empty()
    }

    /// Removes all of its own points with a weight of at least `threshold`, except those that wait for a ghost.
    pub(super) fn sweep(&mut self, threshold: RemovalKey) {
        for point in self.first..self.first + self.own.len() as u32 {
            self.eliminate_around(point, threshold);
        }
    }

    /// Does the same as [`Region::sweep`] for the waiting points.
    pub(super) fn retry(&mut self, threshold: RemovalKey) {
        for point in std::mem::take(&mut self.blocked) {
            self.eliminate_around(point, threshold);
        }
    }

    /// Climbs from `point` along heaviest neighbours to a local maximum, removes it, and repeats until `point` itself is
    /// removed or below the threshold.
    fn eliminate_around(&mut self, point: u32, threshold: RemovalKey) {
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

    fn remove(&mut self, key: RemovalKey) {
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

    /// Recomputes the weight of one of its own points. Subtracts the weights of removed neighbours in the order in
    /// which a heap removes them, because the sum depends on that order.
    fn recompute_weight(&mut self, point: u32) -> RemovalKey {
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
        let last_removed = self.removed_links.last().map_or(RemovalKey::FIRST, |&(key, _)| key);
        self.weights.set(RemovalKey::new(weight, point), last_removed)
    }
}

/// Neighbours of a region's own points.
struct Neighbours {
    /// Neighbours with lower numbers.
    behind: Links,
    /// Neighbours with higher numbers.
    ahead: Links,
}

impl Neighbours {
    /// Returns the neighbours of an own point, ascending in two lists.
    fn of(&self, index: u32) -> [&[Link]; 2] {
        [self.behind.of(index as usize), self.ahead.of(index as usize)]
    }
}

/// The weights of a region's points.
struct Weights {
    first: u32,
    /// Upper bounds of the points' weights; for removed points, their weights at removal.
    keys: Vec<RemovalKey>,
    /// The last removed neighbour of each own point, or [`RemovalKey::NONE`] if the point's weight must be recomputed.
    last_removed: Vec<RemovalKey>,
}

impl Weights {
    /// Creates the weights of `count` own points from `first` on and of some ghosts. All are infinite until they are
    /// known.
    fn new(first: u32, count: u32, ghosts: u32) -> Self {
        let keys = (0..count + ghosts).map(|point| RemovalKey::new(f32::INFINITY, point)).collect();
        Self { first, keys, last_removed: vec![RemovalKey::FIRST; count as usize] }
    }

    fn is_own(&self, point: u32) -> bool {
        (point.wrapping_sub(self.first) as usize) < self.last_removed.len()
    }

    /// Returns whether the weight of an own point must be recomputed.
    fn is_stale(&self, point: u32) -> bool {
        self.last_removed[(point - self.first) as usize] == RemovalKey::NONE
    }

    /// Sets the weight of an own point, computed without the neighbours removed up to `last_removed`.
    fn set(&mut self, key: RemovalKey, last_removed: RemovalKey) -> RemovalKey {
        self.keys[key.point() as usize] = key;
        self.last_removed[(key.point() - self.first) as usize] = last_removed;
        key
    }

    /// Subtracts the weight of a removed neighbour from an own point. If the removals come in another order than a
    /// heap's, the point keeps its weight, which is then too high, until it is recomputed.
    fn subtract_weight(&mut self, point: u32, removed: RemovalKey, by: f32) {
        let key = &mut self.keys[point as usize];
        if key.is_removed() {
            return;
        }
        let last_removed = &mut self.last_removed[(point - self.first) as usize];
        if removed < *last_removed {
            *last_removed = removed;
            *key = RemovalKey::new(key.weight() - by, point);
        } else {
            *last_removed = RemovalKey::NONE;
        }
    }
}

/// Links to points with lower numbers, under construction.
struct BackLinks {
    links: Links,
    /// Next place in the list, and sum of weights so far, for each point.
    next: Vec<(u32, f32)>,
}

impl BackLinks {
    /// Allocates the lists.
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

    /// Adds a link to the own point at `index`. Links are added in ascending order.
    fn add(&mut self, index: u32, link: Link) {
        let (next, total) = &mut self.next[index as usize];
        self.links.list[*next as usize] = link;
        *next += 1;
        *total += link.weight;
    }
}

/// Returns the distinct numbers in ascending order.
fn sorted(numbers: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut numbers: Vec<u32> = numbers.collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}
