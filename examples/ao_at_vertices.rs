//! Turns a stream into AO at the vertices of a mesh: `cargo run --example ao_at_vertices [FILE]`.
//!
//! Without a file it plays `wall.psao`, which `record_own_stream` made: a shadow rises over a wall.

use psao::{AoSampler, Event, Subscriber};

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wall.psao");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut subscriber = Subscriber::open(std::env::args().nth(1).unwrap_or_else(|| SAMPLE.to_owned()))?;

    // The client's own mesh: positions and normals at rest, as in the vertex buffer. Skinning does not matter here.
    let vertices: Vec<[f32; 3]> = (0..40_u8).map(|i| [1.97, f32::from(i) * 0.05, 0.0]).collect();
    let normals = vec![[0.0, 0.0, 1.0]; vertices.len()];

    let mut sampler = AoSampler::new();
    let mut ao = vec![None; vertices.len()];
    while let Some(event) = subscriber.next_event()? {
        let (Event::Frame(info), Some(state)) = (event, subscriber.state()) else { continue };
        // Cheap unless geometry came with the frame.
        sampler.prepare(state);
        for instance in 0..state.layout().instances() as u32 {
            sampler.ao_many(state, instance, &vertices, &normals, &mut ao)?;
            println!("frame {:>3}, instance {instance}: {}", info.frame, shades(&ao));
        }
    }
    Ok(())
}

/// Returns a character for each vertex, from dark to light; `?` where no point is near.
fn shades(ao: &[Option<f32>]) -> String {
    let shade =
        |ao: &Option<f32>| ao.map_or('?', |ao| [' ', '.', ':', '+', '#'][(ao * 4.0).round() as usize]);
    ao.iter().map(shade).collect()
}
