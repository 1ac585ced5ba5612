//! Zstandard blocks: one independent frame each (paper, section 4: level 15, compression strategy 4).

use zstd_safe::{CCtx, CParameter, DCtx, DParameter, ErrorCode, Strategy};

use super::{BlockError, CoderId};

/// The first four bytes of every Zstandard frame (RFC 8878, section 3.1.1).
const MAGIC: [u8; 4] = 0xFD2F_B528_u32.to_le_bytes();
/// Largest window that a frame may use: 2^27 B, as level 22 does. The decoder writes straight into the output and
/// keeps no window. The bound serves streaming readers of the same frames.
const MAX_WINDOW_LOG: u32 = 27;

/// A compression context. It is made on first use and set up again only when the level changes.
#[derive(Default)]
pub(super) struct Encoder {
    context: Option<(CCtx<'static>, i32)>,
}

impl Encoder {
    /// Returns the number of heap bytes in use.
    pub(super) fn heap_bytes(&self) -> usize {
        self.context.as_ref().map_or(0, |(context, _)| context.sizeof())
    }

    /// Compresses `raw` into the start of `buffer`, which never shrinks.
    pub(super) fn compress<'a>(
        &mut self,
        raw: &[u8],
        level: i32,
        buffer: &'a mut Vec<u8>,
    ) -> Result<&'a [u8], BlockError> {
        let room = zstd_safe::compress_bound(raw.len());
        if buffer.len() < room {
            buffer.resize(room, 0);
        }
        let length = self.context(level)?.compress2(buffer.as_mut_slice(), raw).map_err(cannot_compress)?;
        Ok(&buffer[..length])
    }

    fn context(&mut self, level: i32) -> Result<&mut CCtx<'static>, BlockError> {
        if !(1..=22).contains(&level) {
            return Err(BlockError::Level { level });
        }
        let ready = match self.context.take() {
            Some((context, set_up)) if set_up == level => context,
            _ => set_up(level)?,
        };
        Ok(&mut self.context.insert((ready, level)).0)
    }
}

fn set_up(level: i32) -> Result<CCtx<'static>, BlockError> {
    let mut context = CCtx::try_create().ok_or_else(|| BlockError::Coder {
        coder: CoderId::ZSTD,
        reason: "no memory for a compression context".to_owned(),
    })?;
    for parameter in [
        CParameter::CompressionLevel(level),
        CParameter::Strategy(Strategy::ZSTD_lazy),
        CParameter::ContentSizeFlag(true),
        CParameter::ChecksumFlag(false),
        CParameter::DictIdFlag(false),
    ] {
        context.set_parameter(parameter).map_err(cannot_compress)?;
    }
    Ok(context)
}

/// A decompression context, made on first use.
#[derive(Default)]
pub(super) struct Decoder {
    context: Option<DCtx<'static>>,
}

impl Decoder {
    /// Decompresses a frame that [`check_frame`] has passed; it must fill `out` exactly.
    pub(super) fn decompress(&mut self, stored: &[u8], out: &mut [u8]) -> Result<(), BlockError> {
        let mut context = match self.context.take() {
            Some(context) => context,
            None => DCtx::try_create().ok_or_else(|| corrupt("no memory for a decompression context"))?,
        };
        context.set_parameter(DParameter::WindowLogMax(MAX_WINDOW_LOG)).map_err(damaged)?;
        let length = context.decompress(out, stored).map_err(damaged)?;
        self.context = Some(context);
        check_length(out.len(), length as u64)
    }
}

/// Checks that `stored` is one whole frame that declares `raw_bytes`. Nothing is allocated before.
pub(super) fn check_frame(stored: &[u8], raw_bytes: usize) -> Result<(), BlockError> {
    if !stored.starts_with(&MAGIC) {
        return Err(corrupt("it does not start with a Zstandard frame"));
    }
    let frame = zstd_safe::find_frame_compressed_size(stored).map_err(damaged)?;
    if frame != stored.len() {
        return Err(corrupt("bytes follow its frame"));
    }
    match zstd_safe::get_frame_content_size(stored) {
        Ok(Some(declared)) => check_length(raw_bytes, declared),
        Ok(None) => Err(corrupt("its frame does not declare its content size")),
        Err(_) => Err(corrupt("its frame header is damaged")),
    }
}

fn check_length(expected: usize, found: u64) -> Result<(), BlockError> {
    if found == expected as u64 {
        return Ok(());
    }
    Err(BlockError::Length { coder: CoderId::ZSTD, expected: expected as u64, found })
}

fn corrupt(reason: &str) -> BlockError {
    BlockError::Corrupt { coder: CoderId::ZSTD, reason: reason.to_owned() }
}

fn damaged(code: ErrorCode) -> BlockError {
    corrupt(zstd_safe::get_error_name(code))
}

fn cannot_compress(code: ErrorCode) -> BlockError {
    BlockError::Coder { coder: CoderId::ZSTD, reason: zstd_safe::get_error_name(code).to_owned() }
}
