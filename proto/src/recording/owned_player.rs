//! A player that owns the bytes of its recording.

use std::sync::Arc;

use psao_codec::State;

use super::player::Playback;
use super::reader::Position;
use super::{PlayerEvent, PlayerStats, Reader, ReaderError};
use crate::{Limits, Micros};

/// Plays a recording into a state, as [`Player`](super::Player) does, but owns the bytes of the file. Use it in a
/// program that stores a player in a struct.
///
/// ```
/// use psao_proto::Limits;
/// use psao_proto::recording::{OwnedPlayer, Writer};
///
/// let (_, file) = Writer::new(Limits::default());
/// let mut player = OwnedPlayer::new(file, Limits::default())?;
/// assert_eq!(player.next_event(), None);
/// assert!(player.stats().is_clean());
/// # Ok::<(), psao_proto::recording::ReaderError>(())
/// ```
#[derive(Debug)]
pub struct OwnedPlayer {
    bytes: Arc<[u8]>,
    limits: Limits,
    position: Position,
    playback: Playback,
}

impl OwnedPlayer {
    /// Makes a player at the start of a whole file.
    ///
    /// # Errors
    /// [`ReaderError`] when the bytes are not a recording that this version reads.
    pub fn new(bytes: impl Into<Arc<[u8]>>, limits: Limits) -> Result<Self, ReaderError> {
        let bytes = bytes.into();
        let position = Reader::with_limits(&bytes, limits)?.position();
        Ok(Self { bytes, limits, position, playback: Playback::new(limits) })
    }

    /// Plays on to the next event and returns it; `None` at the end of the file.
    pub fn next_event(&mut self) -> Option<PlayerEvent> {
        self.play(|_| true)
    }

    /// Plays on to the next event that arrived by `due` and returns it; `None` if there is none. Damage counts as
    /// arrived.
    pub fn next_event_until(&mut self, due: Micros) -> Option<PlayerEvent> {
        self.play(|next| arrival(next).is_none_or(|arrival| arrival <= due))
    }

    /// Returns the arrival time of the next record; `None` at the end of the file. Damage has the time zero.
    #[must_use]
    pub fn next_arrival(&self) -> Option<Micros> {
        let next = Reader::resume(&self.bytes, self.limits, self.position).next()?;
        Some(next.map_or(Micros(0), |record| record.arrival))
    }

    /// Plays records up to the first event, as long as `may_go_on` returns true for the reader.
    fn play(&mut self, may_go_on: impl Fn(&Reader<'_>) -> bool) -> Option<PlayerEvent> {
        let mut reader = Reader::resume(&self.bytes, self.limits, self.position);
        let mut event = None;
        while event.is_none() && may_go_on(&reader) {
            let Some(step) = self.playback.step(&mut reader) else { break };
            event = step.event;
        }
        self.position = reader.position();
        event
    }

    /// Returns the state after the last frame applied; `None` before the scene table.
    #[must_use]
    pub fn state(&self) -> Option<&State> {
        self.playback.state()
    }

    /// Returns the counts so far.
    #[must_use]
    pub const fn stats(&self) -> PlayerStats {
        self.playback.stats()
    }
}

/// Returns the arrival time of a reader's next record; `None` for damage and at the end.
fn arrival(reader: &Reader<'_>) -> Option<Micros> {
    reader.clone().next()?.ok().map(|record| record.arrival)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Numbering;
    use crate::recording::{Player, Writer};
    use crate::sample::SampleServer;

    /// Returns a recording of six frames with one damaged record.
    fn damaged() -> Vec<u8> {
        let mut source = SampleServer::new().unwrap();
        let mut numbering = Numbering::default();
        let (mut writer, mut file) = Writer::new(Limits::default());
        for frame in numbering.scene(source.scene()).unwrap() {
            file.extend(writer.append(Micros(0), &frame).unwrap());
        }
        for number in 0..6 {
            let body = source.step().unwrap().body;
            let frame = if number == 0 { numbering.keyframe(&body) } else { numbering.update(&body) };
            file.extend(writer.append(Micros(number), &frame.unwrap()).unwrap());
        }
        let middle = file.len() * 3 / 4;
        file[middle] ^= 1;
        file
    }

    #[test]
    fn it_plays_what_a_borrowing_player_plays() {
        let file = damaged();
        let mut borrowing = Player::new(&file, Limits::default()).unwrap();
        let mut owning = OwnedPlayer::new(file.clone(), Limits::default()).unwrap();
        loop {
            let event = owning.next_event();
            assert_eq!(event, borrowing.next_event());
            assert_eq!((owning.state(), owning.stats()), (borrowing.state(), borrowing.stats()));
            if event.is_none() {
                break;
            }
        }
        let mut paced = OwnedPlayer::new(file, Limits::default()).unwrap();
        let mut frames = 0;
        for due in 0..6 {
            while let Some(event) = paced.next_event_until(Micros(due)) {
                frames += u64::from(matches!(event, PlayerEvent::Frame(_)));
            }
            assert!(frames <= due + 1, "{frames} frames by {due}");
            // Everything that arrived by then was played. Behind damage the next arrival may skip a frame's.
            assert!(paced.next_arrival().is_none_or(|arrival| arrival > Micros(due)));
        }
        assert_eq!((frames, paced.next_arrival()), (owning.stats().applied, None));
        assert!(!owning.stats().is_clean() && owning.stats().applied > 0);
        assert!(OwnedPlayer::new(Vec::new(), Limits::default()).is_err());
    }
}
