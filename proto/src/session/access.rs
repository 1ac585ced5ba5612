//! Access of clients to a server.

use crate::message::{Auth, Reject, RejectCode, Token};

/// Clients that a server accepts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Every client: for loopback, links within a process, and connections that are guarded by certificates.
    #[default]
    Open,
    /// Clients that send this token before their HELLO.
    Token(Token),
}

impl Access {
    /// Checks whether a client that sent `auth`, or nothing, may join.
    ///
    /// # Errors
    /// The REJECT that tells the client why it may not.
    pub(super) fn check(&self, auth: Option<&Auth>) -> Result<(), Reject> {
        let refuse = |text| Err(Reject::new(RejectCode::CREDENTIAL, text));
        match (self, auth) {
            (Self::Open, _) => Ok(()),
            (Self::Token(wanted), Some(auth)) if *wanted == auth.token => Ok(()),
            (Self::Token(_), Some(_)) => {
                refuse("the token is not the server's: ask its operator for the right one")
            }
            (Self::Token(_), None) => refuse("the server requires a token: ask its operator for it"),
        }
    }
}
