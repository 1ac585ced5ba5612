//! AUTH: the secret that a server requires from its clients.

use bincode::{Decode, Encode};
use subtle::ConstantTimeEq as _;

use super::sealed::Payload;
use super::{FieldError, Message, require};
use crate::FrameType;

/// Shortest token in bytes, so that it cannot be guessed.
pub const MIN_TOKEN_BYTES: usize = 16;
/// Longest token in bytes.
pub const MAX_TOKEN_BYTES: usize = 256;

/// A secret that server and clients share. It is compared in constant time and never printed.
#[derive(Clone)]
pub struct Token(Vec<u8>);

/// A token is too short or too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "a token of {length} bytes: it must have {MIN_TOKEN_BYTES} to {MAX_TOKEN_BYTES}; `psao keys` makes one"
)]
pub struct TokenError {
    /// Bytes given.
    pub length: usize,
}

impl Token {
    /// Creates a token of 16 to 256 bytes.
    ///
    /// # Errors
    /// [`TokenError`] when it is shorter or longer.
    pub fn new(secret: impl Into<Vec<u8>>) -> Result<Self, TokenError> {
        let secret = secret.into();
        match secret.len() {
            MIN_TOKEN_BYTES..=MAX_TOKEN_BYTES => Ok(Self(secret)),
            length => Err(TokenError { length }),
        }
    }
}

impl PartialEq for Token {
    /// Compares two tokens in a time that depends only on their lengths.
    fn eq(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl Eq for Token {}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Token(secret of {} bytes)", self.0.len())
    }
}

/// The token of a client. A client sends it before HELLO to a server that requires one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Auth {
    /// The secret.
    pub token: Token,
}

impl Encode for Auth {
    fn encode<E: bincode::enc::Encoder>(&self, to: &mut E) -> Result<(), bincode::error::EncodeError> {
        self.token.0.encode(to)
    }
}

impl<C> Decode<C> for Auth {
    fn decode<D: bincode::de::Decoder<Context = C>>(
        from: &mut D,
    ) -> Result<Self, bincode::error::DecodeError> {
        Ok(Self { token: Token(Decode::decode(from)?) })
    }
}

impl Payload for Auth {
    fn check(&self) -> Result<(), FieldError> {
        let length = self.token.0.len();
        require((MIN_TOKEN_BYTES..=MAX_TOKEN_BYTES).contains(&length), "token", "must have 16 to 256 bytes")
    }
}

impl Message for Auth {
    const KIND: FrameType = FrameType::AUTH;
    const NAME: &'static str = "AUTH";
}

#[cfg(test)]
mod tests {
    use super::super::testing::golden;
    use super::*;

    #[test]
    fn golden_bytes() {
        let token = Token::new(*b"sixteen bytes ok").unwrap();
        golden(&Auth { token }, "1000000000000000 7369787465656e206279746573206f6b");
        assert!(Auth { token: Token(vec![0; 257]) }.to_payload().is_err());
    }

    #[test]
    fn a_token_tells_nobody_what_it_is() {
        let token = Token::new(*b"a very secret secret").unwrap();
        assert_eq!(
            format!("{:?}", Auth { token: token.clone() }),
            "Auth { token: Token(secret of 20 bytes) }"
        );
        assert!(token == token.clone() && token != Token::new(*b"a very secret secreT").unwrap());
        for length in [0, 15, 257] {
            assert_eq!(Token::new(vec![7; length]), Err(TokenError { length }));
        }
    }
}
