//! Records a stream of its own AO values into a file: `cargo run --example record_own_stream [FILE]`.
//!
//! Without a file it records into a folder that it removes again.

use psao::{Publisher, RestPoint};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let file = std::env::args().nth(1).map_or_else(|| folder.path().join("own.psao"), Into::into);

    // A wall of 40 x 20 points, 10 cm apart, that looks towards +z.
    let at = |i: u16| [f32::from(i % 40) * 0.1, f32::from(i / 40) * 0.1, 0.0];
    let points: Vec<_> =
        (0..800).map(|i| RestPoint { position: at(i), normal: [0.0, 0.0, 1.0], chart: 0 }).collect();
    let mut builder = Publisher::builder("a rising shadow").fps(30.0);
    let wall = builder.mesh(&points, 0.15);
    let wall = builder.instance(wall);
    let mut publisher = builder.build()?;

    // A thread writes the file. If the disk is slow, frames are missing from the file and marked; the loop never waits.
    publisher.record(&file)?;
    for frame in 0..90_u16 {
        let height = f32::from(frame) / 90.0 * 2.0;
        let ao: Vec<f32> =
            points.iter().map(|point| (0.5 + point.position[1] - height).clamp(0.2, 1.0)).collect();
        publisher.set_all(wall, &ao)?;
        let sent = publisher.send()?;
        if frame % 30 == 0 {
            println!("frame {}: {} bytes, state hash {}", sent.info.frame, sent.body.len(), sent.info.hash);
        }
        std::thread::sleep(std::time::Duration::from_millis(33));
    }
    publisher.finish("done")?;
    println!("recorded {} bytes: look at them with `psao inspect FILE`", std::fs::metadata(&file)?.len());
    Ok(())
}
