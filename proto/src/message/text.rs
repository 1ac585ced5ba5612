//! Texts of limited length.

use bincode::de::read::Reader;
use bincode::de::{BorrowDecoder, Decoder};
use bincode::enc::Encoder;
use bincode::error::{DecodeError, EncodeError};

/// Message of the decoder's error for a text over its limit, which `malformed` recognises.
pub(super) const TOO_LONG: &str = "text over its bound";

/// A UTF-8 text of at most `MAX` bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Text<const MAX: usize>(String);

/// A text is longer than its field allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the text has {length} bytes, over its bound of {limit}: shorten it")]
pub struct TextError {
    /// Bytes of the text.
    pub length: usize,
    /// Bytes allowed.
    pub limit: usize,
}

impl<const MAX: usize> Text<MAX> {
    /// Creates a text.
    ///
    /// # Errors
    /// [`TextError`] when it has more than `MAX` bytes.
    pub fn new(text: impl Into<String>) -> Result<Self, TextError> {
        let text = text.into();
        if text.len() > MAX { Err(TextError { length: text.len(), limit: MAX }) } else { Ok(Self(text)) }
    }

    /// Creates a text of the first characters of `text` that fit, for texts for display.
    #[must_use]
    pub fn cut(text: &str) -> Self {
        Self(text.get(..text.floor_char_boundary(MAX)).unwrap_or(text).to_owned())
    }

    /// Returns the text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<const MAX: usize> std::fmt::Display for Text<MAX> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl<const MAX: usize> AsRef<str> for Text<MAX> {
    fn as_ref(&self) -> &str {
        &self.0
    }
}

impl<const MAX: usize> bincode::Encode for Text<MAX> {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> Result<(), EncodeError> {
        self.0.encode(encoder)
    }
}

impl<C, const MAX: usize> bincode::Decode<C> for Text<MAX> {
    fn decode<D: Decoder<Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        let length = u64::decode(decoder)?;
        // The length is checked before the allocation.
        let length =
            usize::try_from(length).ok().filter(|&l| l <= MAX).ok_or(DecodeError::Other(TOO_LONG))?;
        decoder.claim_bytes_read(length)?;
        let mut bytes = vec![0; length];
        decoder.reader().read(&mut bytes)?;
        String::from_utf8(bytes).map(Self).map_err(|e| DecodeError::Utf8 { inner: e.utf8_error() })
    }
}

impl<'de, C, const MAX: usize> bincode::BorrowDecode<'de, C> for Text<MAX> {
    fn borrow_decode<D: BorrowDecoder<'de, Context = C>>(decoder: &mut D) -> Result<Self, DecodeError> {
        bincode::Decode::decode(decoder)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_in_bytes_and_cutting_keeps_characters_whole() {
        assert_eq!(Text::<4>::new("abcde"), Err(TextError { length: 5, limit: 4 }));
        assert_eq!(Text::<4>::new("abcd").unwrap().as_str(), "abcd");
        assert_eq!(Text::<4>::cut("abcé").as_str(), "abc");
        assert_eq!(Text::<5>::cut("abcé!").as_str(), "abcé");
        assert_eq!(Text::<9>::cut("ab").as_str(), "ab");
    }
}
