//! Writes the seeds of the fuzz corpora of this crate:
//! `cargo run -p psao-proto --features testing --example corpus -- fuzz/corpus`.

use std::path::PathBuf;

use psao_proto::fuzzing::Seed;

#[expect(clippy::disallowed_methods, reason = "an example may write files; the crate may not")]
fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let folder = PathBuf::from(std::env::args_os().nth(1).ok_or("usage: corpus FOLDER")?);
    for Seed { target, name, bytes } in psao_proto::fuzzing::seeds()? {
        let folder = folder.join(target);
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join(name), &bytes)?;
        println!("{target}/{name}: {} bytes", bytes.len());
    }
    Ok(())
}
