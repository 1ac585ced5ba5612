//! A recording as a stream to follow.

use std::collections::VecDeque;
use std::path::Path;
use std::time::Instant;

use psao_codec::State;
use psao_codec::envelope::FrameError;
use psao_proto::recording::{OwnedPlayer, PlayerEvent, Repaired, repair};
use psao_proto::{FollowError, Limits, Micros};

use super::{Event, SubscribeError};

/// A recording that is being played.
#[derive(Debug)]
pub(super) struct File {
    player: OwnedPlayer,
    /// When [`File::poll`] was first called, and the arrival of the record that came next then.
    started: Option<(Instant, Micros)>,
    /// What was repaired, and is not told yet.
    repaired: VecDeque<Repaired>,
}

impl File {
    pub(super) fn open(path: &Path) -> Result<Self, SubscribeError> {
        let mut bytes =
            std::fs::read(path).map_err(|source| SubscribeError::Read { path: path.to_owned(), source })?;
        let repaired = repair(&mut bytes, Limits::default()).into();
        let player = OwnedPlayer::new(bytes, Limits::default())
            .map_err(|source| SubscribeError::Recording { path: path.to_owned(), source })?;
        Ok(Self { player, started: None, repaired })
    }

    pub(super) fn next_event(&mut self) -> Option<Event> {
        let repaired = self.repaired.pop_front().map(Event::Repaired);
        repaired.or_else(|| self.player.next_event().map(event))
    }

    pub(super) fn poll(&mut self) -> Option<Event> {
        if let Some(repaired) = self.repaired.pop_front() {
            return Some(Event::Repaired(repaired));
        }
        let next = self.player.next_arrival()?;
        let (started, first) = *self.started.get_or_insert_with(|| (Instant::now(), next));
        let elapsed = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
        self.player.next_event_until(first.plus(Micros(elapsed))).map(event)
    }

    pub(super) fn is_over(&self) -> bool {
        self.repaired.is_empty() && self.player.next_arrival().is_none()
    }

    pub(super) fn state(&self) -> Option<&State> {
        self.player.state()
    }
}

fn event(event: PlayerEvent) -> Event {
    match event {
        PlayerEvent::Scene(scene) => Event::Scene(scene),
        PlayerEvent::Frame(frame) => Event::Frame(frame.info),
        PlayerEvent::Unusable {
            frame: Some(frame),
            reason: FollowError::Body(FrameError::Hash { stored, computed, .. }),
            ..
        } => Event::HashMismatch { frame, expected: stored, found: computed },
        PlayerEvent::Unusable { reason, .. } => Event::Unusable(reason),
        PlayerEvent::BadMessage { error, .. } => Event::BadMessage(error),
        PlayerEvent::Report(report) => Event::Report(report),
        PlayerEvent::Budget(budget) => Event::Budget(budget),
        PlayerEvent::Edit(edit) => Event::Edit(edit),
        PlayerEvent::Gap(gap) => Event::Gap(gap),
        PlayerEvent::Closed(close) => Event::Closed(close),
        PlayerEvent::Damage(damage) => Event::Damage(damage),
    }
}
