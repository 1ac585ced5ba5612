//! Decodes a stream into AO at its own points: `cargo run --example decode_points [FILE or HOST:PORT]`.
//!
//! Without an argument it plays `wall.psao`, which `record_own_stream` made.

use psao::codec::surface::BLOCK_POINTS;
use psao::{Event, Subscriber};

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wall.psao");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let source = std::env::args().nth(1).unwrap_or_else(|| SAMPLE.to_owned());
    let is_file = std::path::Path::new(&source).exists();
    let mut subscriber = if is_file { Subscriber::open(&source)? } else { Subscriber::connect(&source)? };
    subscriber.track_changes();

    let mut last = None;
    while let Some(event) = subscriber.next_event()? {
        let Event::Frame(info) = event else { continue };
        // What changed since the frame before: enough to update a buffer without copying all of it.
        let changed = last.and_then(|last| Some(subscriber.changed_since(last)?.count()));
        match changed {
            Some(points) => println!("frame {}: {points} points changed", info.frame),
            None => println!("frame {}: all points may have changed", info.frame),
        }
        last = Some(info.frame);
    }

    // The state is plain arrays: points of a set, AO bytes of an instance.
    let state = subscriber.state().and_then(|state| state.as_surface()).ok_or("not a surface stream")?;
    for (instance, member) in (0..).zip(state.layout().members()) {
        let Some(points) = state.geometry(member.set) else { continue };
        let (mut sum, mut count) = (0.0, 0_u32);
        for (i, ao) in state.values(instance).iter().enumerate() {
            if state.is_present(instance, i / BLOCK_POINTS) && points.position(i)[0].is_finite() {
                (sum, count) = (sum + f32::from(*ao) / 255.0, count + 1);
            }
        }
        println!("instance {instance}: {count} points, mean accessibility {:.3}", sum / count.max(1) as f32);
    }
    Ok(())
}
