//! Concatenating recordings.

use super::rewrite::Rewriter;
use super::{Player, RewriteError, RewriteOutcome};
use crate::Limits;

/// Concatenates recordings into one.
///
/// Each recording continues one frame interval after the last arrival, and its groups are renumbered. Bodies are copied
/// byte for byte, with their frame numbers and times. A scene table is written only if it differs from the one in force
/// or if edits have changed the scene since; otherwise the next keyframe is enough. Only the last CLOSE is kept.
/// Damaged frames are left out, and so are the frames that build on them.
///
/// ```
/// use psao_proto::Limits;
/// use psao_proto::recording::{Concatenation, Summary};
/// use psao_proto::sample::recording;
///
/// let mut file = Vec::new();
/// let put = |bytes: &[u8]| {
///     file.extend_from_slice(bytes);
///     Ok::<(), std::convert::Infallible>(())
/// };
/// let mut both = Concatenation::new(Limits::default(), put)?;
/// both.add(&recording(5, 3)?)?;
/// both.add(&recording(4, 4)?)?;
/// both.finish()?;
/// assert_eq!(Summary::scan(&file, Limits::default())?.frames().len(), 9);
/// # Ok::<(), Box<dyn std::error::Error + Send + Sync>>(())
/// ```
#[derive(Debug)]
pub struct Concatenation<P> {
    limits: Limits,
    out: Rewriter<P>,
}

impl<E, P: FnMut(&[u8]) -> Result<(), E>> Concatenation<P> {
    /// Creates an empty recording, whose bytes go to `put`.
    ///
    /// # Errors
    /// [`RewriteError::Put`].
    pub fn new(limits: Limits, put: P) -> Result<Self, RewriteError<E>> {
        Ok(Self { limits, out: Rewriter::new(limits, put)? })
    }

    /// Adds a recording and returns its outcome.
    ///
    /// # Errors
    /// [`RewriteError`]; [`RewriteError::Reader`] when the bytes are not a recording. In that case nothing was added.
    pub fn add(&mut self, file: &[u8]) -> Result<RewriteOutcome, RewriteError<E>> {
        let mut player = Player::new(file, self.limits)?;
        self.out.next_file();
        while let Some(step) = player.next_step() {
            self.out.copy(&step, &player)?;
        }
        self.out.end_of_file(player.stats().lost)?;
        Ok(self.out.losses.take())
    }

    /// Ends the recording with the last CLOSE and an index, and returns its length in bytes.
    ///
    /// # Errors
    /// As [`add`](Self::add).
    pub fn finish(mut self) -> Result<u64, RewriteError<E>> {
        self.out.finish()
    }
}
