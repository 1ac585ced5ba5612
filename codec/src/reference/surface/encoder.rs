//! The twin of [`crate::surface::Encoder`] as far as it decides: which points a frame sends, and what clients hold then.

use std::sync::Arc;

use super::BlockInfo;
use crate::envelope::FrameKind;
use crate::surface::{BLOCK_POINTS, EncoderSettings, Layout};

/// Decides as [`crate::surface::Encoder`] does and writes nothing: no lists of what is due, no bytes.
#[derive(Debug, Clone)]
pub struct SurfaceReferenceEncoder {
    layout: Arc<Layout>,
    settings: EncoderSettings,
    /// Bytes as last offered, by point.
    offered: Vec<Option<u8>>,
    /// What clients hold, by point.
    held: Vec<Option<u8>>,
    /// How much a difference counts, by point.
    weights: Vec<u64>,
    /// Frames that have postponed the point in a row.
    waited: Vec<u64>,
}

impl SurfaceReferenceEncoder {
    /// Nothing offered, nothing held.
    #[must_use]
    pub fn new(layout: Arc<Layout>, settings: EncoderSettings) -> SurfaceReferenceEncoder {
        let points = layout.points() as usize;
        SurfaceReferenceEncoder {
            layout,
            settings,
            offered: vec![None; points],
            held: vec![None; points],
            weights: vec![1; points],
            waited: vec![0; points],
        }
    }

    /// Says what a point's AO is now, as [`crate::surface::Encoder::set_ao`].
    pub fn set_ao(&mut self, point: u32, ao: u8) -> Option<bool> {
        *self.offered.get_mut(point as usize)? = Some(ao);
        Some(self.is_due(point as usize))
    }

    fn is_due(&self, point: usize) -> bool {
        match (self.held[point], self.offered[point]) {
            (Some(held), Some(offered)) => held.abs_diff(offered) >= self.settings.threshold,
            (None, Some(_)) => true,
            (_, None) => false,
        }
    }

    /// Points that the next delta changes.
    #[must_use]
    pub fn due(&self) -> Vec<u32> {
        let due = (0..self.held.len()).filter(|point| self.held[*point].is_some() && self.is_due(*point));
        due.map(|point| point as u32).collect()
    }

    /// Says how much a block counts, as [`crate::surface::Encoder::set_weight`].
    pub fn set_weight(&mut self, instance: u32, block: usize, weight: u16) {
        let points = self.layout.points_of(instance).skip(block * BLOCK_POINTS).take(BLOCK_POINTS);
        points.for_each(|point| self.weights[point] = u64::from(weight.max(1)));
    }

    /// Points that the next delta changes, in the order of a budget, and how many of them cannot wait.
    #[must_use]
    pub fn ranked(&self) -> (Vec<u32>, usize) {
        let longest = self.settings.budget.map_or(0, |budget| u64::from(budget.longest_age));
        let (forced, mut others): (Vec<u32>, Vec<u32>) =
            self.due().into_iter().partition(|point| self.waited[*point as usize] >= longest);
        others.sort_by_key(|point| std::cmp::Reverse(self.priority(*point)));
        (forced.iter().chain(&others).copied().collect(), forced.len())
    }

    /// Difference, weight and age.
    #[must_use]
    pub fn priority(&self, point: u32) -> u64 {
        let at = point as usize;
        let difference =
            self.held[at].zip(self.offered[at]).map_or(0, |(held, offered)| held.abs_diff(offered));
        u64::from(difference) * self.weights[at] * (self.waited[at] + 1)
    }

    /// Frames that have postponed a point in a row.
    #[must_use]
    pub fn waited(&self, point: u32) -> u64 {
        self.waited.get(point as usize).copied().unwrap_or(0)
    }

    /// What a frame does to clients that changes these points among those due.
    pub fn finish(&mut self, kind: FrameKind, sent: &[u32]) {
        let due = self.due();
        for point in 0..self.held.len() {
            let waits =
                kind == FrameKind::Delta && due.contains(&(point as u32)) && !sent.contains(&(point as u32));
            self.waited[point] = if waits { self.waited[point] + 1 } else { 0 };
        }
        for point in sent {
            let at = *point as usize;
            let (held, offered) = (self.held[at], self.offered[at]);
            self.held[at] = held.zip(offered).map(|(held, offered)| self.moved(held, offered));
        }
        // Points of a block come together.
        let mut first = 0;
        for BlockInfo { points, .. } in BlockInfo::all(&self.layout) {
            let block = first..first + points;
            first += points;
            let arrives = self.held[block.clone()].contains(&None) || kind == FrameKind::Key;
            if arrives && self.offered[block.clone()].iter().any(Option::is_some) {
                for point in block {
                    self.held[point] = self.offered[point].or(Some(255));
                }
            }
        }
    }

    /// The byte of those that clients can be told to take that is nearest to the one offered, but not the one they hold;
    /// of two the further one.
    fn moved(&self, held: u8, offered: u8) -> u8 {
        let quantum = usize::from(self.settings.quantum());
        let away = usize::from(held.abs_diff(offered));
        let steps = (1..=256).rev().min_by_key(|steps| away.abs_diff(steps * quantum)).unwrap_or(1);
        let step = (steps * quantum).min(255) as u8;
        if offered < held { held.saturating_sub(step) } else { held.saturating_add(step) }
    }

    /// The byte that clients hold of a point; `None` where nothing came.
    #[must_use]
    pub fn held(&self, point: u32) -> Option<u8> {
        *self.held.get(point as usize)?
    }

    /// The byte last offered of a point.
    #[must_use]
    pub fn offered(&self, point: u32) -> Option<u8> {
        *self.offered.get(point as usize)?
    }
}
