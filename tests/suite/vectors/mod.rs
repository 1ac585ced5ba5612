//! The vectors of `tests/vectors`: bodies and what they do to a state, for decoders that are not this one.

mod accepted;
pub(crate) mod json;
mod refused;
mod scenes;
mod stand;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use psao_codec::envelope::{FrameError, FrameInfo};

use scenes::Stream;
use stand::Stand;

/// A body, and where it belongs.
struct Vector {
    name: String,
    /// The layout of its stream.
    layout: &'static str,
    /// The vector whose state it is applied to; `None` for the empty state.
    after: Option<String>,
    body: Vec<u8>,
    /// Whether its json lists all AO, or leaves that to the hash.
    full: bool,
}

fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/vectors/v1"))
}

fn vectors() -> Vec<Vector> {
    let mut all = accepted::vectors();
    all.extend(refused::vectors(&all));
    all
}

/// Layouts by name.
fn streams() -> BTreeMap<&'static str, Stream> {
    scenes::all().into_iter().map(|stream| (stream.name(), stream)).collect()
}

/// Applies `vector` with `body` to the state that `bodies` make before it.
fn outcome(
    vector: &Vector,
    streams: &BTreeMap<&'static str, Stream>,
    by_name: &BTreeMap<&str, (&Vector, Vec<u8>)>,
) -> (Stand, Result<FrameInfo, FrameError>) {
    let mut chain = vec![];
    let mut before = vector.after.as_deref();
    while let Some(name) = before {
        let (earlier, body) = &by_name[name];
        chain.push(body);
        before = earlier.after.as_deref();
    }
    let mut stand = Stand::new(&streams[vector.layout]);
    for body in chain.into_iter().rev() {
        stand.apply(body).unwrap();
    }
    let untouched = stand.clone();
    let result = stand.apply(&by_name[vector.name.as_str()].1);
    if result.is_err() {
        assert_eq!(stand, untouched, "{}: a refused body changes nothing", vector.name);
    }
    (stand, result)
}

/// The json of every vector, from these bodies.
fn told(vectors: &[Vector], body: impl Fn(&Vector) -> Vec<u8>) -> BTreeMap<String, String> {
    let streams = streams();
    let by_name = vectors.iter().map(|vector| (vector.name.as_str(), (vector, body(vector)))).collect();
    let one = |vector: &Vector| {
        let (stand, result) = outcome(vector, &streams, &by_name);
        (vector.name.clone(), json::vector(vector, &stand, &result))
    };
    vectors.iter().map(one).collect()
}

/// Compares a file with what it should hold. With `PSAO_BLESS` set a missing one is written; what is there already is
/// never changed.
pub(crate) fn compare(path: &Path, wanted: &[u8]) {
    if std::env::var_os("PSAO_BLESS").is_some() && !path.exists() {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, wanted).unwrap();
    }
    assert!(
        path.exists(),
        "no {}: `PSAO_BLESS=1 cargo test -p psao-tests vectors` writes it",
        path.display()
    );
    let found = fs::read(path).unwrap();
    assert!(
        found == wanted,
        "{} is not what the code writes now. Vectors never change: what decoded once has to decode for ever",
        path.display()
    );
}

fn file(name: &str, ending: &str) -> PathBuf {
    folder().join(format!("{name}.{ending}"))
}

#[test]
fn the_code_writes_the_vectors_as_they_are() {
    let vectors = vectors();
    for stream in scenes::all() {
        compare(&file(&format!("layouts/{}", stream.name()), "json"), json::layout(&stream).as_bytes());
    }
    for vector in &vectors {
        compare(&file(&vector.name, "bin"), &vector.body);
    }
    for (name, text) in told(&vectors, |vector| vector.body.clone()) {
        compare(&file(&name, "json"), text.as_bytes());
    }
}

#[test]
fn the_stored_vectors_do_what_their_json_says() {
    let vectors = vectors();
    for (name, text) in told(&vectors, |vector| fs::read(file(&vector.name, "bin")).unwrap()) {
        assert_eq!(fs::read_to_string(file(&name, "json")).unwrap(), text, "{name}");
    }
    let mut names: Vec<String> = vectors.iter().map(|vector| vector.name.clone()).collect();
    names.sort();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count, "a name is there twice");
    let stored =
        fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut stored: Vec<String> =
        stored.filter_map(|name| name.strip_suffix(".bin").map(str::to_owned)).collect();
    stored.sort();
    assert_eq!(stored, names, "a vector is there that nobody writes");
}

/// What a body of a decoder's own making does not reach by chance is in the vectors.
#[test]
fn the_vectors_cover_the_format() {
    let (streams, vectors) = (streams(), vectors());
    let by_name =
        vectors.iter().map(|vector| (vector.name.as_str(), (vector, vector.body.clone()))).collect();
    let mut met = std::collections::BTreeSet::new();
    let mut reasons = std::collections::BTreeSet::new();
    for vector in &vectors {
        match outcome(vector, &streams, &by_name).1 {
            Ok(info) => {
                let (profile, packing, kind) = (info.profile.0, info.packing.0, info.kind.to_string());
                met.extend(
                    info.sections.iter().map(|s| (profile, packing, kind.clone(), s.tag.0, s.coder.0)),
                );
            }
            Err(error) => {
                reasons.insert(json::reason(&error));
            }
        }
    }
    for kind in ["keyframe", "delta"] {
        for (packing, tag, coder) in (1..4)
            .flat_map(|packing| (1..4).flat_map(move |tag| (0..3).map(move |coder| (packing, tag, coder))))
        {
            assert!(
                met.contains(&(1, packing, kind.to_owned(), tag, coder)),
                "paper {packing} {kind} {tag} {coder}"
            );
        }
        for (tag, coder) in (4..7).flat_map(|tag| (0..4).map(move |coder| (tag, coder))) {
            let possible = tag != 6 || kind == "delta";
            assert_eq!(
                met.contains(&(2, 0, kind.to_owned(), tag, coder)),
                possible,
                "surface {kind} {tag} {coder}"
            );
        }
    }
    for coder in 0..3 {
        assert!(met.contains(&(2, 0, "keyframe".to_owned(), 7, coder)), "context {coder}");
    }
    for coder in 0..4 {
        assert!(met.contains(&(2, 0, "delta".to_owned(), 8, coder)), "patch {coder}");
    }
    for coder in 1..3 {
        assert!(met.contains(&(2, 0, "delta".to_owned(), 7, coder)), "context with a patch {coder}");
    }
    assert_eq!(reasons.into_iter().collect::<Vec<_>>(), json::REASONS);
}
