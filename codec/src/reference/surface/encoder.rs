//! The reference of the decisions of [`crate::surface::Encoder`]: which points a frame sends, and what clients hold
//! then.

use std::sync::Arc;

use super::BlockInfo;
use crate::envelope::FrameKind;
use crate::surface::{BLOCK_POINTS, EncoderSettings, Layout, NO_VALUE};

/// Decides as [`crate::surface::Encoder`] does. It writes nothing and keeps no lists of due points.
#[derive(Debug, Clone)]
pub struct SurfaceReferenceEncoder {
    layout: Arc<Layout>,
    settings: EncoderSettings,
    /// Bytes as last set, by point.
    latest: Vec<Option<u8>>,
    /// Bytes of clients, by point.
    held: Vec<Option<u8>>,
    /// Weight of a difference, by point.
    weights: Vec<u64>,
    /// Number of consecutive frames that have postponed the point.
    waited: Vec<u64>,
}

impl SurfaceReferenceEncoder {
    /// Creates an encoder in which nothing was set or sent.
    #[must_use]
    pub fn new(layout: Arc<Layout>, settings: EncoderSettings) -> SurfaceReferenceEncoder {
        let points = layout.points() as usize;
        SurfaceReferenceEncoder {
            layout,
            settings,
            latest: vec![None; points],
            held: vec![None; points],
            weights: vec![1; points],
            waited: vec![0; points],
        }
    }

    /// Sets the AO of a point, as [`crate::surface::Encoder::set_ao`].
    pub fn set_ao(&mut self, point: u32, ao: u8) -> Option<bool> {
        *self.latest.get_mut(point as usize)? = Some(ao);
        Some(self.is_due(point as usize))
    }

    fn is_due(&self, point: usize) -> bool {
        match (self.held[point], self.latest[point]) {
            (Some(held), Some(latest)) if held == NO_VALUE || latest == NO_VALUE => held != latest,
            (Some(held), Some(latest)) => held.abs_diff(latest) >= self.settings.threshold,
            (None, Some(_)) => true,
            (_, None) => false,
        }
    }

    /// Returns the points that the next delta changes.
    #[must_use]
    pub fn due(&self) -> Vec<u32> {
        let due = (0..self.held.len()).filter(|point| self.held[*point].is_some() && self.is_due(*point));
        due.map(|point| point as u32).collect()
    }

    /// Sets the weight of a block, as [`crate::surface::Encoder::set_weight`].
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        let points = self.layout.points_of(instance).skip(block * BLOCK_POINTS).take(BLOCK_POINTS);
        points.for_each(|point| self.weights[point] = u64::from(weight.max(1)));
    }

    /// Returns the points that the next delta changes, in the order of a budget, and how many of them must not wait.
    #[must_use]
    pub fn ranked(&self) -> (Vec<u32>, usize) {
        let longest = self.settings.budget.map_or(0, |budget| u64::from(budget.longest_age));
        let (forced, mut others): (Vec<u32>, Vec<u32>) =
            self.due().into_iter().partition(|point| self.waited[*point as usize] >= longest);
        others.sort_by_key(|point| std::cmp::Reverse(self.priority(*point)));
        (forced.iter().chain(&others).copied().collect(), forced.len())
    }

    /// Returns the product of difference, weight and age.
    #[must_use]
    pub fn priority(&self, point: u32) -> u64 {
        let at = point as usize;
        let difference = match (self.held[at], self.latest[at]) {
            (Some(held), Some(latest)) if held != latest && (held == NO_VALUE || latest == NO_VALUE) => 255,
            (Some(held), Some(latest)) => held.abs_diff(latest),
            _ => 0,
        };
        u64::from(difference) * self.weights[at] * (self.waited[at] + 1)
    }

    /// Returns the number of consecutive frames that have postponed a point.
    #[must_use]
    pub fn waited(&self, point: u32) -> u64 {
        self.waited.get(point as usize).copied().unwrap_or(0)
    }

    /// Updates the clients by a frame that changes these of the due points.
    pub fn finish(&mut self, kind: FrameKind, sent: &[u32]) {
        let due = self.due();
        for point in 0..self.held.len() {
            let waits =
                kind == FrameKind::Delta && due.contains(&(point as u32)) && !sent.contains(&(point as u32));
            self.waited[point] = if waits { self.waited[point] + 1 } else { 0 };
        }
        for point in sent {
            let at = *point as usize;
            let (held, latest) = (self.held[at], self.latest[at]);
            self.held[at] = held.zip(latest).map(|(held, latest)| self.moved(held, latest));
        }
        // Points of a block arrive together.
        let mut first = 0;
        for BlockInfo { points, .. } in BlockInfo::all(&self.layout) {
            let block = first..first + points;
            first += points;
            let arrives = self.held[block.clone()].contains(&None) || kind == FrameKind::Key;
            if arrives && self.latest[block.clone()].iter().any(Option::is_some) {
                for point in block {
                    self.held[point] = self.latest[point].or(Some(255));
                }
            }
        }
    }

    /// Returns the byte after a change: of the bytes that a change can reach, except the one held, the nearest to the byte
    /// set. Of two, the one further away. A value goes at once.
    fn moved(&self, held: u8, latest: u8) -> u8 {
        let quantum = usize::from(self.settings.quantum());
        if latest == NO_VALUE {
            return NO_VALUE;
        }
        if held == NO_VALUE {
            let reached = (0..256).map(|steps| 1 + steps * quantum);
            let nearest = reached.rev().min_by_key(|byte| byte.abs_diff(latest.into()));
            return nearest.map_or(latest, |byte| byte.min(255) as u8);
        }
        let away = usize::from(held.abs_diff(latest));
        let steps = (1..=256).rev().min_by_key(|steps| away.abs_diff(steps * quantum)).unwrap_or(1);
        let step = (steps * quantum).min(255) as u8;
        if latest < held { held.saturating_sub(step).max(1) } else { held.saturating_add(step) }
    }

    /// Returns the byte of a point that clients hold; `None` if none was received.
    #[must_use]
    pub fn held(&self, point: u32) -> Option<u8> {
        *self.held.get(point as usize)?
    }

    /// Returns the byte of a point as last set.
    #[must_use]
    pub fn latest(&self, point: u32) -> Option<u8> {
        *self.latest.get(point as usize)?
    }
}
