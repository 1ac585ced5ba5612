//! The twin of [`crate::surface::Encoder`] as far as it decides: which points a frame sends, and what clients hold then.

use std::sync::Arc;

use super::Spot;
use crate::frame::FrameKind;
use crate::surface::{EncoderSettings, Layout};

/// Decides as [`crate::surface::Encoder`] does and writes nothing: no lists of what is due, no bytes.
#[derive(Debug, Clone)]
pub struct NaiveSurfaceEncoder {
    layout: Arc<Layout>,
    settings: EncoderSettings,
    /// Bytes as last offered, by point.
    offered: Vec<Option<u8>>,
    /// What clients hold, by point.
    held: Vec<Option<u8>>,
}

impl NaiveSurfaceEncoder {
    /// Nothing offered, nothing held.
    #[must_use]
    pub fn new(layout: Arc<Layout>, settings: EncoderSettings) -> NaiveSurfaceEncoder {
        let points = layout.points() as usize;
        NaiveSurfaceEncoder { layout, settings, offered: vec![None; points], held: vec![None; points] }
    }

    /// Says what a point's AO is now, as [`crate::surface::Encoder::offer`].
    pub fn offer(&mut self, point: u32, ao: u8) -> Option<bool> {
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

    /// What a frame does to clients.
    pub fn finish(&mut self, kind: FrameKind) {
        for point in self.due() {
            let at = point as usize;
            let (held, offered) = (self.held[at], self.offered[at]);
            self.held[at] = held.zip(offered).map(|(held, offered)| self.moved(held, offered));
        }
        // Points of a block come together.
        let mut first = 0;
        for Spot { points, .. } in Spot::all(&self.layout) {
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
