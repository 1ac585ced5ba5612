//! Unix sockets.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use super::*;

async fn listen_at(path: &Path) -> Result<(Hub, Listener, SampleServer), NetError> {
    let source = SampleServer::new().unwrap();
    let hub = Hub::new(source.scene().clone(), source.coder(), Access::Open, Limits::default());
    let listener = Listener::bind(&hub, &Address::Unix(path.to_owned()), &ListenOptions::default()).await?;
    Ok((hub, listener, source))
}

#[tokio::test]
async fn a_unix_socket_is_its_owners_and_goes_with_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("psao.socket");
    let (hub, listener, mut source) = listen_at(&path).await.unwrap();
    assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    let address = listener.address().clone();
    let running = tokio::spawn(listener.run());
    let client = tokio::spawn(follow(address));
    assert!(hub.wait_joined(1, PATIENCE).await);
    let events = hub.take_events();
    let ours = Some(std::process::id().cast_signed());
    assert!(
        matches!(&events[..], [HubEvent::Joined { peer: Peer::Unix { process }, .. }] if *process == ours),
        "{events:?}"
    );
    let frame = source.step().unwrap();
    hub.broadcast(&frame.info, frame.body, source.state().into(), hub.now()).unwrap();
    assert!(hub.wait_acked(frame.info.frame, PATIENCE).await);
    hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    assert_eq!(client.await.unwrap().0.len(), 1);
    running.await.unwrap();
    assert!(!path.exists());
}

#[expect(clippy::disallowed_methods, reason = "a test puts a file in the way")]
#[tokio::test]
async fn a_socket_is_replaced_only_if_it_is_one_and_nothing_answers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("psao.socket");
    let (_hub, listener, _) = listen_at(&path).await.unwrap();
    let error = listen_at(&path).await.unwrap_err();
    assert!(matches!(error, NetError::InUse { .. }), "{error}");

    // A killed server leaves its file: the socket is closed, but the file stays.
    let stale = folder.path().join("stale.socket");
    drop(std::os::unix::net::UnixListener::bind(&stale).unwrap());
    let error = dial(&Address::Unix(stale.clone())).await.unwrap_err();
    assert!(matches!(error, NetError::Refused { .. }), "{error}");
    let (_, second, _) = listen_at(&stale).await.unwrap();

    // A file that another server put in its place is not removed.
    std::fs::remove_file(&path).unwrap();
    let (_, third, _) = listen_at(&path).await.unwrap();
    drop(listener);
    assert!(path.exists());
    drop((second, third));
    assert!(!path.exists() && !stale.exists());
    let error = dial(&Address::Unix(path.clone())).await.unwrap_err();
    assert!(matches!(error, NetError::Refused { .. }), "{error}");

    std::fs::write(&path, "precious").unwrap();
    let error = listen_at(&path).await.unwrap_err();
    assert!(matches!(error, NetError::NotASocket { .. }), "{error}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
}
