//! Canonical LEB128: seven bits a byte, low bits first, only the shortest form.

/// Largest length of a 32-bit varint, bytes.
const MAX_BYTES: usize = 5;

/// Why a varint was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VarintError {
    /// The last byte carries no bits, so a shorter form exists.
    #[error("it is not in its shortest form")]
    NotShortest,
    /// The value does not fit 32 bits.
    #[error("it does not fit 32 bits")]
    TooLarge,
}

/// Why a varint could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReadVarintError {
    /// The bytes ended before the varint did.
    Ends,
    /// The varint is malformed.
    Malformed(VarintError),
}

/// Reads the varint at the start of `bytes`. Returns its value and its length in bytes, 1 to 5.
pub(crate) fn read_varint(bytes: &[u8]) -> Result<(u32, usize), ReadVarintError> {
    let mut value: u64 = 0;
    for (place, byte) in bytes.iter().take(MAX_BYTES).enumerate() {
        value |= u64::from(byte & 0x7F) << (7 * place);
        if byte & 0x80 == 0 {
            if *byte == 0 && place > 0 {
                return Err(ReadVarintError::Malformed(VarintError::NotShortest));
            }
            return match u32::try_from(value) {
                Ok(value) => Ok((value, place + 1)),
                Err(_) => Err(ReadVarintError::Malformed(VarintError::TooLarge)),
            };
        }
    }
    if bytes.len() < MAX_BYTES {
        Err(ReadVarintError::Ends)
    } else {
        Err(ReadVarintError::Malformed(VarintError::TooLarge))
    }
}

/// Appends `value` in its shortest form (1 to 5 bytes).
pub(crate) fn write_varint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push((value as u8) | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Returns the number of bytes that [`write_varint`] appends.
pub(crate) fn varint_bytes(value: u32) -> usize {
    (32 - (value | 1).leading_zeros()).div_ceil(7) as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn golden_bytes() {
        let cases: [(u32, &[u8]); 6] = [
            (0, &[0]),
            (127, &[0x7F]),
            (128, &[0x80, 1]),
            (300, &[0xAC, 2]),
            (1 << 28, &[0x80, 0x80, 0x80, 0x80, 1]),
            (u32::MAX, &[0xFF, 0xFF, 0xFF, 0xFF, 0x0F]),
        ];
        for (value, expected) in cases {
            let mut out = Vec::new();
            write_varint(&mut out, value);
            assert_eq!(out, expected);
        }
    }

    #[test]
    fn malformed_ones_are_refused() {
        let not_shortest = Err(ReadVarintError::Malformed(VarintError::NotShortest));
        let too_large = Err(ReadVarintError::Malformed(VarintError::TooLarge));
        assert_eq!(read_varint(&[0x80, 0]), not_shortest);
        assert_eq!(read_varint(&[0xFF, 0x80, 0x80, 0x80, 0]), not_shortest);
        assert_eq!(read_varint(&[0xFF, 0xFF, 0xFF, 0xFF, 0x1F]), too_large);
        assert_eq!(read_varint(&[0x80, 0x80, 0x80, 0x80, 0x80, 1]), too_large);
    }

    proptest! {
        #[test]
        fn round_trip_and_every_prefix(value in any::<u32>(), shift in 0_u32..32) {
            let mut out = Vec::new();
            write_varint(&mut out, value >> shift);
            let length = out.len();
            out.push(0xAA);
            prop_assert_eq!(read_varint(&out), Ok((value >> shift, length)));
            for end in 0..length {
                prop_assert_eq!(read_varint(&out[..end]), Err(ReadVarintError::Ends));
            }
        }

        #[test]
        fn what_is_read_is_what_would_be_written(bytes in prop::collection::vec(any::<u8>(), 0..8)) {
            if let Ok((value, length)) = read_varint(&bytes) {
                let mut out = Vec::new();
                write_varint(&mut out, value);
                prop_assert_eq!(&out, &bytes[..length]);
            }
        }
    }
}
