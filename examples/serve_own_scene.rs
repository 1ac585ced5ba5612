//! Serves a scene and AO values of its own, and follows them with a client: `cargo run --example serve_own_scene [ADDRESS]`.

use std::f32::consts::TAU;
use std::time::Duration;

use psao::{Event, Publisher, RestPoint, Subscriber};

/// Points in a row of the floor.
const ROW: u16 = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let address = std::env::args().nth(1).unwrap_or_else(|| "127.0.0.1:0".to_owned());

    // The scene: a floor of 3.2 m by 3.2 m with a point every 5 cm. Normals point up.
    let at = |i: u16| [f32::from(i % ROW) * 0.05, 0.0, f32::from(i / ROW) * 0.05];
    let points: Vec<_> =
        (0..ROW * ROW).map(|i| RestPoint { position: at(i), normal: [0.0, 1.0, 0.0], chart: 0 }).collect();
    let mut builder = Publisher::builder("a ball over a floor").fps(60.0).threshold(4);
    let floor = builder.mesh(&points, 0.075);
    let floor = builder.instance(floor);
    let mut publisher = builder.build()?;

    let bound = publisher.listen(&address)?;
    println!("serving at {bound}");
    let client = std::thread::spawn(move || follow(&bound.to_string()).map_err(|error| error.to_string()));
    publisher.wait_for_clients(1, Duration::from_secs(5))?;

    // Each frame, compute AO and set it; the publisher finds out what changed. Here a ball circles over the floor.
    for frame in 0..120_u16 {
        let angle = f32::from(frame) / 120.0 * TAU;
        let ball = [1.6 + angle.cos(), 0.3, 1.6 + angle.sin()];
        for (i, point) in (0..).zip(&points) {
            publisher.set_ao(floor, i, under_ball(point.position, ball, 0.25))?;
        }
        publisher.send()?;
        std::thread::sleep(Duration::from_millis(16));
    }
    publisher.finish("the ball has come round")?;
    println!("{}", client.join().map_err(|_| "the client failed")??);
    Ok(())
}

/// Returns how much of the hemisphere above a floor point a ball leaves open (form factor of a sphere).
fn under_ball(point: [f32; 3], ball: [f32; 3], radius: f32) -> f32 {
    let to_ball: [f32; 3] = std::array::from_fn(|axis| ball[axis] - point[axis]);
    let distance2: f32 = to_ball.iter().map(|v| v * v).sum();
    1.0 - to_ball[1] / distance2.sqrt() * radius * radius / distance2
}

/// Follows the server to its end, as a program elsewhere would.
fn follow(address: &str) -> Result<String, psao::SubscribeError> {
    let (mut subscriber, mut frames, mut bytes) = (Subscriber::connect(address)?, 0, 0);
    while let Some(event) = subscriber.next_event()? {
        if let Event::Frame(info) = event {
            (frames, bytes) = (frames + 1, bytes + info.body_bytes());
        }
    }
    Ok(format!("the client applied {frames} frames of {} bytes on average", bytes / frames.max(1)))
}
