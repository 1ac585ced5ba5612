//! A small soak test: many clients at once, some of which take no bytes.

#[path = "../examples/soak/load.rs"]
mod load;
#[path = "../examples/soak/source.rs"]
mod source;

use load::{Load, follow, listen, serve};
use psao_codec::block::BlockCoder;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn good_clients_follow_while_others_take_nothing() {
    let load = Load { clients: 20, stalled: 4, hz: 60.0, seconds: 2.0 };
    for coder in [BlockCoder::Lz4, BlockCoder::Range] {
        let mut source = source::Source::new(200, coder, 60.0).unwrap();
        let (hub, address) = listen(&source, coder).await.unwrap();
        let clients = tokio::spawn(async move { follow(&address, load).await });
        let served = serve(&hub, &mut source, load, |_, _| {}).await.unwrap();
        let seen = clients.await.unwrap().unwrap();
        assert_eq!((served.joined, seen.len()), (20, 16));
        for one in &seen {
            assert_eq!((one.unusable, &one.error), (0, &None));
            assert!(one.frames > 1, "it follows");
        }
        let applied = seen.iter().map(|one| one.frames).max();
        assert!(applied <= Some(served.frames), "{applied:?} of {}", served.frames);
        // A stalled client leaves bytes unread, so its system may reset the connection at the end.
        assert!(served.faults.len() <= 4, "{:?}", served.faults);
    }
}
