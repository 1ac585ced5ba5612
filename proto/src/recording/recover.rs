//! What is whole of a damaged recording.

use super::rewrite::{LossCounter, LossError};
use super::{Player, PlayerEvent, RewriteError, RewriteOutcome, Writer};
use crate::{FrameIndex, FrameType, Limits, Micros, Numbering};

/// Copies what is whole of a recording, byte for byte, into one with an index, and gives it to `put` piece by piece.
///
/// Damage is dropped, and with it the frames that build on what is lost: the new recording plays without a fault. With
/// `keep_all` whole frames are kept although nothing can be done with them. A GAP mark stands where something of the
/// stream is missing.
///
/// # Errors
/// [`RewriteError`]; not for damage, whatever its extent.
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
        if header.kind == FrameType::INDEX {
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

/// The recording that is made.
struct Recovery<P> {
    writer: Writer,
    put: P,
    losses: LossCounter,
    arrival: Micros,
}

impl<E, P: FnMut(&[u8]) -> Result<(), E>> Recovery<P> {
    /// Marks what is lost before frame `next`.
    fn write_gap(&mut self, player: &Player<'_>, next: Option<FrameIndex>) -> Result<(), RewriteError<E>> {
        let Some(gap) = self.losses.take_gap(player.stats().lost, next) else { return Ok(()) };
        self.append(&Numbering::default().message(&gap)?, None)
    }

    /// Writes a frame, of which `event` is what the player made of it.
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
