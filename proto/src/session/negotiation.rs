//! Checks whether a server can serve a client, by its HELLO.

use psao_codec::Layout;

use super::{NEWEST_VERSION, OLDEST_VERSION, SessionError, read};
use crate::message::{Hello, MessageError, PeerLimits, Reject, RejectCode};
use crate::{CoderId, SceneTable};

/// Returns the HELLO of a client that can follow a stream of `scene`.
///
/// # Errors
/// [`SessionError::BadHello`] with the REJECT that tells it why it cannot.
pub(super) fn negotiate(payload: &[u8], scene: &SceneTable) -> Result<Hello, SessionError> {
    let reject = |code, text: &str| SessionError::BadHello(Reject::new(code, text));
    let hello: Hello = match versions(payload) {
        Some((oldest, newest)) if oldest > NEWEST_VERSION || newest < OLDEST_VERSION => {
            let error = SessionError::Version { peer: "client", oldest, newest };
            return Err(reject(RejectCode::VERSION, &error.to_string()));
        }
        _ => read(payload).map_err(|e: MessageError| reject(RejectCode::BAD_HELLO, &e.to_string()))?,
    };
    let info = scene.info();
    if !hello.profiles.has(scene.profile()) {
        return Err(reject(RejectCode::PROFILE, "the client cannot apply the stream's profile"));
    }
    if !hello.coders.has(info.coder) || !hello.coders.has(CoderId::STORED) {
        return Err(reject(RejectCode::CODER, "the client cannot undo the stream's block coder"));
    }
    match over_limits(scene.layout(), &hello.limits) {
        Some(text) => Err(reject(RejectCode::LIMITS, &text)),
        None => Ok(hello),
    }
}

/// Returns why the scene exceeds the client's limits; `None` when it does not.
fn over_limits(layout: &Layout, takes: &PeerLimits) -> Option<String> {
    let instances = layout.instances() as u32;
    let needs = match layout {
        Layout::Paper(layout) => [
            ("instances", instances, takes.instances),
            ("buckets", layout.bucket_total(), takes.buckets),
            ("cells", layout.cell_capacity(), takes.cells),
        ],
        Layout::Surface(layout) => [
            ("instances", instances, takes.instances),
            ("point sets", layout.sets().len() as u32, takes.instances),
            ("points", layout.points(), takes.points),
        ],
    };
    let over = |(what, need, take): &(&str, u32, u32)| {
        (need > take)
            .then(|| format!("the scene has {need} {what}; the client takes {take}: raise its limits"))
    };
    needs.iter().find_map(over)
}

/// Returns the version range at the start of a HELLO of any protocol version.
fn versions(payload: &[u8]) -> Option<(u16, u16)> {
    let &[o0, o1, n0, n1] = payload.first_chunk()?;
    Some((u16::from_le_bytes([o0, o1]), u16::from_le_bytes([n0, n1])))
}
