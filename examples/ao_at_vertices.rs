//! Turns a stream into AO at the vertices of a mesh: `cargo run --example ao_at_vertices [FILE]`.
//!
//! Without a file it plays `wall.psao`, which `record_own_stream` made: a shadow rises over a wall.

use psao::{AoSampler, Event, Place, Subscriber};

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wall.psao");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut subscriber = Subscriber::open(std::env::args().nth(1).unwrap_or_else(|| SAMPLE.to_owned()))?;

    // The client's own mesh: positions and normals at rest, as in the vertex buffer, and the chart of each (`Charts`). The
    // wall is flat: one chart. Skinning does not matter here.
    let vertex = |i: u8| Place {
        position: [1.97, f32::from(i) * 0.05, 0.0],
        normal: [0.0, 0.0, 1.0],
        chart: 0,
        spacing: 0.0,
    };
    let vertices: Vec<Place> = (0..40).map(vertex).collect();

    let mut sampler = AoSampler::new();
    let mut ao = vec![None; vertices.len()];
    while let Some(event) = subscriber.next_event()? {
        let (Event::Frame(info), Some(state)) = (event, subscriber.state()) else { continue };
        // Cheap unless geometry came with the frame.
        sampler.prepare(state);
        for instance in 0..state.layout().instances() as u32 {
            sampler.ao_many(state, instance, &vertices, &mut ao)?;
            println!("frame {:>3}, instance {instance}: {}", info.frame, shades(&ao));
        }
    }
    Ok(())
}

/// Returns a character for each vertex, from dark to light; `?` where its chart has no point.
fn shades(ao: &[Option<f32>]) -> String {
    let shade =
        |ao: &Option<f32>| ao.map_or('?', |ao| [' ', '.', ':', '+', '#'][(ao * 4.0).round() as usize]);
    ao.iter().map(shade).collect()
}
