//! URIs in glTF files: data within the file, and paths beside it (glTF 2.0, section 2.8).

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

/// Exporters disagree about padding, which says nothing.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Target of a URI.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Target {
    /// The bytes of a data URI.
    Data(Vec<u8>),
    /// A path relative to the glTF file.
    Path(String),
}

/// Resolves a URI, or returns the reason why that is impossible.
pub(super) fn resolve(uri: &str) -> Result<Target, String> {
    if let Some(rest) = uri.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return data(&uri[rest.len()..]).map(Target::Data);
    }
    // A colon in the first segment ends a scheme; later it belongs to a name (RFC 3986, section 4.2).
    if uri.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err(format!("`{}` is neither a data URI nor a relative path", uri.escape_debug()));
    }
    String::from_utf8(percent_decoded(uri))
        .map(Target::Path)
        .map_err(|_| format!("`{}` is not UTF-8 once decoded", uri.escape_debug()))
}

/// Decodes a data URI of any media type (RFC 2397), from the end of its scheme.
fn data(rest: &str) -> Result<Vec<u8>, String> {
    let (head, body) = rest.split_once(',').ok_or("data URI: the comma before the data is missing")?;
    let bytes = percent_decoded(body);
    if !head.to_ascii_lowercase().ends_with(";base64") {
        return Ok(bytes);
    }
    BASE64.decode(bytes).map_err(|error| format!("data URI: {error}"))
}

/// Returns the bytes of a URI with its `%XX` escapes resolved.
fn percent_decoded(uri: &str) -> Vec<u8> {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let digits = bytes.get(i + 1..i + 3).filter(|_| bytes[i] == b'%');
        let digits = digits.filter(|d| d.iter().all(u8::is_ascii_hexdigit));
        match digits.and_then(|d| std::str::from_utf8(d).ok()).and_then(|d| u8::from_str_radix(d, 16).ok()) {
            Some(byte) => {
                out.push(byte);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_escapes_are_resolved() {
        let path = |uri: &str| resolve(uri);
        assert_eq!(path("a%20b.bin"), Ok(Target::Path("a b.bin".to_owned())));
        assert_eq!(path("50%.bin"), Ok(Target::Path("50%.bin".to_owned())));
        assert_eq!(path("%zz%4"), Ok(Target::Path("%zz%4".to_owned())));
        assert_eq!(path("./a:b.bin"), Ok(Target::Path("./a:b.bin".to_owned())));
        assert!(
            path("%ff").is_err() && path("http://example.org/a.bin").is_err() && path("c:a.bin").is_err()
        );
    }

    #[test]
    fn data_of_any_media_type_is_decoded() {
        let data = |text: &str| match resolve(text) {
            Ok(Target::Data(bytes)) => bytes,
            other => panic!("{text}: {other:?}"),
        };
        for head in ["", "application/gltf-buffer", "text/plain;charset=utf-8", "x-anything/at-all"] {
            assert_eq!(data(&format!("data:{head};base64,AQID")), [1, 2, 3], "{head}");
        }
        assert_eq!(data("data:;base64,AQI="), [1, 2]);
        assert_eq!(data("DATA:;BASE64,AQI"), [1, 2], "without padding");
        assert_eq!(data("data:;base64,AQI%3D"), [1, 2], "with escaped padding");
        assert_eq!(data("data:,a%00b"), [b'a', 0, b'b'], "without base64");
        assert!(resolve("data:;base64,!!!").is_err() && resolve("data:nothing").is_err());
    }
}
