//! Recovering the undamaged frames of a recording.

use super::rewrite::{LossCounter, LossError};
use super::{Player, PlayerEvent, RewriteError, RewriteOutcome, Writer};
use crate::{FrameIndex, FrameType, Limits, Micros, Numbering};

/// Copies the playable frames of a recording, byte for byte, and passes the bytes of a new recording with an index to
/// `put`.
///
/// Damaged records and the frames that build on them are dropped, so the new recording plays without errors. With
/// `keep_all` whole frames that cannot be applied are kept. A GAP message marks each place where frames are missing.
///
/// # Errors
/// [`RewriteError`]; damage is never an error.
pub fn recover<E>(
    file: &[u8],
    keep_all: bool,
    limits: Limits,
    mut put: impl FnMut(&[u8]) -> Result<(), E>,
) -> Result<RewriteOutcome, RewriteError<E>> {
    let mut player = Player::new(file, limits)?;
    let (writer, head) = Writer::new(limits);
    put(&head).map_err(RewriteError::Put)?;
    let mut copy = Recovery { writer, put, losses: LossCounter::default(), arrival: Micros(0) };
    while let Some(step) = player.next_step() {
        let loss = LossError::of(&step);
        let record = match (loss, step.record) {
            (None, Some(record)) => record,
            (Some(_), Some(record)) if keep_all => record,
            (loss, _) => {
                loss.into_iter().for_each(|loss| copy.losses.add(loss));
                continue;
            }
        };
        let header = record.frame.header;
        if matches!(header.kind, FrameType::INDEX | FrameType::PARITY) {
            continue;
        }
        copy.arrival = record.arrival;
        if header.kind.carries_state() {
            let number = match &step.event {
                Some(PlayerEvent::Frame(frame)) => Some(frame.info.frame),
                Some(PlayerEvent::Unusable { frame, .. }) => *frame,
                _ => None,
            };
            copy.write_gap(&player, number)?;
            copy.losses.count_frame();
        }
        copy.append(record.frame.bytes, step.event.as_ref())?;
    }
    copy.write_gap(&player, None)?;
    (copy.put)(&copy.writer.finish()?).map_err(RewriteError::Put)?;
    Ok(copy.losses.take())
}

/// The new recording.
struct Recovery<P> {
    writer: Writer,
    put: P,
    losses: LossCounter,
    arrival: Micros,
}

impl<E, P: FnMut(&[u8]) -> Result<(), E>> Recovery<P> {
    /// Writes a GAP for the frames lost before frame `next`.
    fn write_gap(&mut self, player: &Player<'_>, next: Option<FrameIndex>) -> Result<(), RewriteError<E>> {
        let Some(gap) = self.losses.take_gap(player.stats().lost, next) else { return Ok(()) };
        self.append(&Numbering::default().message(&gap)?, None)
    }

    /// Writes a frame. `event` is the player's event for it.
    fn append(&mut self, frame: &[u8], event: Option<&PlayerEvent>) -> Result<(), RewriteError<E>> {
        let record = match event {
            Some(PlayerEvent::Frame(played)) => {
                self.writer.append_parsed(self.arrival, frame, Some(&played.info))?
            }
            _ => self.writer.append(self.arrival, frame)?,
        };
        (self.put)(&record).map_err(RewriteError::Put)
    }
}
