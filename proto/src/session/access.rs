//! Who may join.

use crate::message::{Auth, Reject, RejectCode, Token};

/// Whom a server takes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Access {
    /// Whoever connects: for loopback, for links within a process, and for connections whose certificate says enough.
    #[default]
    Open,
    /// Whoever sends this token before its HELLO.
    Token(Token),
}

impl Access {
    /// Whether a client that sent `auth`, or nothing, may join.
    ///
    /// # Errors
    /// The REJECT that tells it why not.
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
