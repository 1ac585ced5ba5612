//! Replays a recording into a client at the pace at which it was recorded: `cargo run --example replay_file [FILE]`.
//!
//! Without a file it plays `wall.psao`, which `record_own_stream` made.

use std::time::Duration;

use psao::{Event, Subscriber};

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wall.psao");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut subscriber = Subscriber::open(std::env::args().nth(1).unwrap_or_else(|| SAMPLE.to_owned()))?;
    let mut drawn = 0_u32;
    // The frame loop of a renderer: take what has come, then draw. `poll` never waits.
    while !subscriber.is_over() {
        while let Some(event) = subscriber.poll()? {
            match event {
                Event::Scene(scene) => {
                    println!("scene {}: {} points", scene.info().name, scene.point_count());
                }
                Event::Frame(info) => {
                    println!("picture {drawn}: frame {}, state hash {}", info.frame, info.hash);
                }
                Event::Gap(gap) => println!("picture {drawn}: {gap}"),
                Event::Damage(damage) => println!("picture {drawn}: {damage}"),
                _ => {}
            }
        }
        // Here the renderer draws with `subscriber.state()`.
        drawn += 1;
        std::thread::sleep(Duration::from_millis(16));
    }
    println!("{drawn} pictures were drawn meanwhile");
    Ok(())
}
