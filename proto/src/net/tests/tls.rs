//! TLS: which clients are accepted, and the errors of both ends.

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose, date_time_ymd,
};

use super::*;

/// PEM texts of one authority, and of a server and a client that it signed.
struct Certificates {
    authority: String,
    server: Pair,
    client: Pair,
    expired: Pair,
}

struct Pair {
    certificate: String,
    key: String,
}

impl Certificates {
    fn new(authority: &str) -> Self {
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.distinguished_name.push(DnType::CommonName, authority);
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        let key = KeyPair::generate().unwrap();
        let authority = params.self_signed(&key).unwrap().pem();
        let issuer = Issuer::new(params, key);
        let pair = |usage, expired: bool| {
            let mut params = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
            params.extended_key_usages = vec![usage];
            if expired {
                params.not_before = date_time_ymd(2001, 1, 1);
                params.not_after = date_time_ymd(2002, 1, 1);
            }
            let key = KeyPair::generate().unwrap();
            let certificate = params.signed_by(&key, &issuer).unwrap().pem();
            Pair { certificate, key: key.serialize_pem() }
        };
        Self {
            authority,
            server: pair(ExtendedKeyUsagePurpose::ServerAuth, false),
            client: pair(ExtendedKeyUsagePurpose::ClientAuth, false),
            expired: pair(ExtendedKeyUsagePurpose::ServerAuth, true),
        }
    }

    fn client_tls(&self, identity: Option<&Pair>) -> ClientTls {
        let identity = identity.map(|pair| (pair.certificate.as_bytes(), pair.key.as_bytes()));
        ClientTls::from_pem(self.authority.as_bytes(), identity).unwrap()
    }
}

impl Pair {
    fn server_tls(&self, client_authority: Option<&str>) -> ServerTls {
        let authority = client_authority.map(str::as_bytes);
        ServerTls::from_pem(self.certificate.as_bytes(), self.key.as_bytes(), authority).unwrap()
    }
}

/// Starts a server at `localhost`, the name in the certificates.
async fn start_tls(tls: ServerTls) -> (Hub, Address, SampleServer) {
    let source = SampleServer::new().unwrap();
    let hub = Hub::new(source.scene().clone(), source.coder(), Access::Open, Limits::default());
    let options = ListenOptions::default().with_tls(tls);
    let listener = Listener::bind(&hub, &"tls:localhost:0".parse().unwrap(), &options).await.unwrap();
    let address = listener.address().clone();
    tokio::spawn(listener.run());
    (hub, address, source)
}

/// Connects and follows to the first event or error.
async fn attempt(address: &Address, tls: ClientTls) -> Result<(), NetError> {
    let options = ConnectOptions::default().with_tls(tls);
    let mut connection = connect(address, &options, Limits::default()).await?;
    while connection.session().state().is_none() {
        connection.next_event().await?;
    }
    connection.session().close(CloseCode::DONE, "seen enough");
    connection.flush().await
}

/// Returns why the next client left.
async fn left(hub: &Hub) -> Option<PeerError> {
    loop {
        for event in hub.take_events() {
            if let HubEvent::Left { error, .. } = event {
                return error;
            }
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}

#[tokio::test]
async fn frames_go_over_tls_to_clients_with_a_certificate() {
    let made = Certificates::new("trial");
    let (hub, address, mut source) = start_tls(made.server.server_tls(Some(&made.authority))).await;
    let options = ConnectOptions::default().with_tls(made.client_tls(Some(&made.client)));
    let mut connection = connect(&address, &options, Limits::default()).await.unwrap();
    let sending = async {
        assert!(hub.wait_joined(1, PATIENCE).await);
        for _ in 0..5 {
            let frame = source.step().unwrap();
            hub.broadcast(&frame.info, frame.body, source.state().into(), hub.now()).unwrap();
            assert!(hub.wait_acked(frame.info.frame, PATIENCE).await);
        }
        hub.close(CloseCode::DONE, "enough", PATIENCE).await;
    };
    let following = async {
        let mut applied = 0;
        while let Some(event) = connection.next_event().await.unwrap() {
            applied += usize::from(matches!(event, ClientEvent::Applied(_)));
        }
        assert_eq!(applied, 5);
    };
    tokio::join!(sending, following);
    let events = hub.take_events();
    assert!(matches!(events[0], HubEvent::Joined { peer: Peer::Tls(_), .. }), "{events:?}");
    assert!(matches!(events[1], HubEvent::Left { error: None, .. }), "{events:?}");
}

/// Each failure has an error type of its own at both ends, and does not affect the server.
#[tokio::test]
async fn certificates_that_do_not_hold_are_told_at_both_ends() {
    type Problem = TlsCertificateError;
    let (made, other) = (Certificates::new("trial"), Certificates::new("another"));
    let namesake = Certificates::new("trial");
    let told = |error: NetError| match error {
        NetError::Tls { source, .. } => source,
        error => panic!("{error}"),
    };

    let (hub, address, _) = start_tls(made.expired.server_tls(None)).await;
    let error = told(attempt(&address, made.client_tls(None)).await.unwrap_err());
    assert_eq!(error, TlsError::PeerCertificate(Problem::Expired));
    assert_eq!(left(&hub).await, Some(PeerError::Tls(TlsError::OwnCertificate(Problem::Expired))));

    let (hub, address, _) = start_tls(made.server.server_tls(Some(&made.authority))).await;
    for stranger in [&other, &namesake] {
        let error = told(attempt(&address, stranger.client_tls(None)).await.unwrap_err());
        assert_eq!(error, TlsError::PeerCertificate(Problem::UnknownAuthority));
        let expected = TlsError::OwnCertificate(Problem::UnknownAuthority);
        assert_eq!(left(&hub).await, Some(PeerError::Tls(expected)));
    }

    let Address::Tls(place) = &address else { panic!("{address}") };
    let by_number = Address::Tls(HostPort { host: "127.0.0.1".to_owned(), ..place.clone() });
    let error = told(attempt(&by_number, made.client_tls(None)).await.unwrap_err());
    let TlsError::PeerCertificate(Problem::WrongName { expected, presented }) = &error else {
        panic!("{error}")
    };
    assert_eq!((expected.as_str(), presented.contains("localhost")), ("127.0.0.1", true), "{presented}");
    let fault = left(&hub).await;
    assert!(matches!(fault, Some(PeerError::Tls(TlsError::OwnCertificate(Problem::Other(_))))), "{fault:?}");

    let error = told(attempt(&address, made.client_tls(None)).await.unwrap_err());
    assert_eq!(error, TlsError::OwnCertificate(Problem::Missing));
    assert_eq!(left(&hub).await, Some(PeerError::Tls(TlsError::PeerCertificate(Problem::Missing))));

    // The client's certificate has another authority than the server requires. The client trusts the server.
    for stranger in [&other, &namesake] {
        let error = told(attempt(&address, made.client_tls(Some(&stranger.client))).await.unwrap_err());
        assert_eq!(error, TlsError::OwnCertificate(Problem::UnknownAuthority));
        let expected = TlsError::PeerCertificate(Problem::UnknownAuthority);
        assert_eq!(left(&hub).await, Some(PeerError::Tls(expected)));
    }

    attempt(&address, made.client_tls(Some(&made.client))).await.unwrap();
    assert_eq!(left(&hub).await, None);
}

#[tokio::test]
async fn tls_and_plain_ends_are_told_apart() {
    let made = Certificates::new("trial");
    let (hub, plain, _) = start(Limits::default()).await;
    let Address::Tcp(place) = &plain else { panic!("{plain}") };
    let error = attempt(&Address::Tls(place.clone()), made.client_tls(None)).await.unwrap_err();
    assert!(matches!(error, NetError::Tls { source: TlsError::Closed, .. }), "{error}");
    assert_eq!(left(&hub).await, Some(PeerError::TlsAtPlainPort));

    let (hub, address, _) = start_tls(made.server.server_tls(None)).await;
    let Address::Tls(place) = &address else { panic!("{address}") };
    let mut connection = dial(&Address::Tcp(place.clone())).await.unwrap();
    let error = connection.next_event().await.unwrap_err();
    assert!(matches!(error, NetError::SpeaksTls { .. }), "{error}");
    drop(connection);
    assert_eq!(left(&hub).await, Some(PeerError::Tls(TlsError::NotTls)));

    // A mail server answers a TLS client.
    let (mail, address) = stranger().await;
    tokio::spawn(async move {
        let (mut stream, _) = mail.accept().await.unwrap();
        stream.write_all(b"220 mail").await.unwrap();
        let _ = stream.read(&mut [0; 1000]).await;
    });
    let Address::Tcp(place) = address else { panic!("{address}") };
    let error = attempt(&Address::Tls(place), made.client_tls(None)).await.unwrap_err();
    assert!(matches!(error, NetError::Tls { source: TlsError::NotTls, .. }), "{error}");
}

/// The test pauses tokio's clock.
#[tokio::test(start_paused = true)]
async fn a_silent_tls_handshake_runs_into_the_deadline() {
    let made = Certificates::new("trial");
    let (hub, address, _) = start_tls(made.server.server_tls(None)).await;
    let Address::Tls(place) = &address else { panic!("{address}") };
    let mut silent = TcpStream::connect(place.to_string()).await.unwrap();
    let mut answer = Vec::new();
    silent.read_to_end(&mut answer).await.unwrap();
    assert!(answer.is_empty());
    let fault = left(&hub).await;
    let expected = matches!(fault, Some(PeerError::Session(SessionError::HandshakeTimeout { .. })));
    assert!(expected, "{fault:?}");

    let (_mute, address) = stranger().await;
    let Address::Tcp(place) = address else { panic!("{address}") };
    let error = attempt(&Address::Tls(place), made.client_tls(None)).await.unwrap_err();
    assert!(matches!(error, NetError::ConnectTimeout { .. }), "{error}");
}

#[tokio::test]
async fn what_tls_needs_is_checked_before_anything_listens_or_connects() {
    let made = Certificates::new("trial");
    let (hub, plain, _) = start(Limits::default()).await;
    let address: Address = "tls:localhost:0".parse().unwrap();
    let error = Listener::bind(&hub, &address, &ListenOptions::default()).await.unwrap_err();
    assert!(matches!(error, NetError::TlsNeeds { .. }), "{error}");
    let error = dial(&address).await.unwrap_err();
    assert!(error.to_string().contains("certificate of the authority"), "{error}");
    let options = ListenOptions::default().with_tls(made.server.server_tls(None));
    let error = Listener::bind(&hub, &local(), &options).await.unwrap_err();
    assert!(matches!(error, NetError::TlsUnused { .. }), "{error}");
    let error = attempt(&plain, made.client_tls(None)).await.unwrap_err();
    assert!(matches!(error, NetError::TlsUnused { .. }), "{error}");

    let (certificate, key) = (made.server.certificate.as_bytes(), made.server.key.as_bytes());
    let error = ServerTls::from_pem(b"", key, None).unwrap_err().to_string();
    assert!(error.starts_with("there is no certificate"), "{error}");
    let error = ServerTls::from_pem(certificate, certificate, None).unwrap_err().to_string();
    assert!(error.starts_with("there is no private key"), "{error}");
    let error = ServerTls::from_pem(certificate, made.client.key.as_bytes(), None).unwrap_err();
    assert!(matches!(error, TlsConfigError::OtherKey), "{error}");
    let error = ClientTls::from_pem(key, None).unwrap_err().to_string();
    assert!(error.starts_with("there is no authority's certificate"), "{error}");
    let tls = made.server.server_tls(None);
    assert_eq!(format!("{tls:?}"), "ServerTls { requires_client_certificates: false, .. }");
}

#[tokio::test]
async fn addresses_that_others_can_reach_need_tls_and_a_credential() {
    let made = Certificates::new("trial");
    let (hub, ..) = start(Limits::default()).await;
    let anonymous = ListenOptions::default().with_tls(made.server.server_tls(None));
    let guarded = ListenOptions::default().with_tls(made.server.server_tls(Some(&made.authority)));
    let plain = ListenOptions::default();
    for (host, options) in [
        ("0.0.0.0", &plain),
        ("[::]", &plain),
        ("[::ffff:0.0.0.0]", &plain),
        ("192.0.2.1", &plain),
        ("tls:0.0.0.0", &anonymous),
    ] {
        let address: Address = format!("{host}:0").parse().unwrap();
        let error = Listener::bind(&hub, &address, options).await.unwrap_err();
        assert!(matches!(error, NetError::Exposed { .. }), "{error}");
        assert!(error.to_string().contains("a token or client certificates"), "{error}");
    }
    let open = plain.with_exposure(Exposure::OpenToEveryone);
    for (address, options) in [("tls:0.0.0.0:0", &guarded), ("0.0.0.0:0", &open)] {
        let address = address.parse().unwrap();
        Listener::bind(&hub, &address, options).await.unwrap();
    }
}
