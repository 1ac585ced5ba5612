//! Listening and connecting: addresses, certificates, tokens.

use std::path::{Path, PathBuf};

use clap::Args;
use psao_proto::Limits;
use psao_proto::message::{RejectCode, Token};
use psao_proto::net::{
    Address, ClientTls, ConnectOptions, Connection, Exposure, Hub, HubEvent, ListenOptions, Listener,
    NetError, ServerTls, connect,
};
use psao_proto::session::{Access, ClientOptions, SessionError};

use crate::error::{Exit, Failure, Outcome};

/// Where a server listens unless told otherwise.
const DEFAULT_ADDRESS: &str = "127.0.0.1:4700";
/// The environment variable that holds a token where no file is named.
const TOKEN_VARIABLE: &str = "PSAO_TOKEN";

/// Heading of the options in `--help`.
pub(crate) const NETWORK: &str = "Network";

/// Where a server listens, and which clients it accepts.
#[derive(Args, Clone, Debug)]
pub(crate) struct ListenArgs {
    /// Address to listen at: host:port, tls:host:port or unix:PATH; port 0 lets the system choose. `psao serve` uses
    /// 127.0.0.1:4700 unless given
    #[arg(long, value_name = "ADDR", help_heading = NETWORK)]
    pub(crate) listen: Option<Address>,
    /// The server's certificate, for a tls: address (`psao keys` creates one)
    #[arg(long, value_name = "PEM", requires = "key", help_heading = NETWORK)]
    cert: Option<PathBuf>,
    /// The private key of --cert
    #[arg(long, value_name = "PEM", requires = "cert", help_heading = NETWORK)]
    key: Option<PathBuf>,
    /// Accept only clients with a certificate signed by this authority
    #[arg(long, value_name = "PEM", requires = "cert", help_heading = NETWORK)]
    client_ca: Option<PathBuf>,
    #[command(flatten)]
    token: TokenArgs,
    /// Serve every client, even at an address that other machines can reach without TLS or a credential
    #[arg(long, help_heading = NETWORK)]
    open_to_everyone: bool,
}

/// How a client proves its identity, and knows the server.
#[derive(Args, Clone, Debug)]
pub(crate) struct ConnectArgs {
    /// Trust servers with a certificate signed by this authority; required for a tls: address
    #[arg(long, value_name = "PEM", help_heading = NETWORK)]
    ca: Option<PathBuf>,
    /// The certificate to show to a server that asks for one
    #[arg(long, value_name = "PEM", requires_all = ["key", "ca"], help_heading = NETWORK)]
    cert: Option<PathBuf>,
    /// The private key of --cert
    #[arg(long, value_name = "PEM", requires = "cert", help_heading = NETWORK)]
    key: Option<PathBuf>,
    #[command(flatten)]
    token: TokenArgs,
    /// Send the token even without TLS to another machine, readable on the way
    #[arg(long, help_heading = NETWORK)]
    token_in_clear: bool,
}

/// The secret that server and clients share.
#[derive(Args, Clone, Debug)]
struct TokenArgs {
    /// File with the token that server and clients share [default: the variable `PSAO_TOKEN`]
    #[arg(long, value_name = "FILE", help_heading = NETWORK)]
    token_file: Option<PathBuf>,
}

impl ListenArgs {
    /// Returns which clients may join.
    pub(crate) fn access(&self) -> Outcome<Access> {
        Ok(self.token.read()?.map_or(Access::Open, Access::Token))
    }

    /// Listens for clients of `hub` at the address, or at the default one, and serves them in the background. Returns the
    /// address with the port that was chosen.
    pub(crate) async fn serve(&self, hub: &Hub) -> Outcome<Address> {
        let address = match &self.listen {
            Some(address) => address.clone(),
            None => DEFAULT_ADDRESS.parse().map_err(Failure::usage)?,
        };
        let mut options = ListenOptions::default();
        if let (Some(cert), Some(key)) = (&self.cert, &self.key) {
            let (cert, key) = (read(cert)?, read_secret(key)?);
            let authority = self.client_ca.as_deref().map(read).transpose()?;
            let tls = ServerTls::from_pem(&cert, &key, authority.as_deref()).map_err(Failure::input)?;
            options = options.with_tls(tls);
        }
        if self.open_to_everyone {
            options = options.with_exposure(Exposure::OpenToEveryone);
        }
        let listener = Listener::bind(hub, &address, &options).await.map_err(refused)?;
        let bound = listener.address().clone();
        tokio::spawn(listener.run());
        Ok(bound)
    }
}

impl ConnectArgs {
    /// Connects to a server with the options of `session`, except that the token is the command line's.
    pub(crate) async fn connect(&self, address: &Address, session: ClientOptions) -> Outcome<Connection> {
        let session = session.with_token(self.token.read()?);
        let mut options =
            ConnectOptions::default().with_session(session).with_token_in_clear(self.token_in_clear);
        if let Some(ca) = &self.ca {
            let ca = read(ca)?;
            let identity = match (&self.cert, &self.key) {
                (Some(cert), Some(key)) => Some((read(cert)?, read_secret(key)?)),
                _ => None,
            };
            let identity = identity.as_ref().map(|(cert, key)| (&cert[..], &key[..]));
            options = options.with_tls(ClientTls::from_pem(&ca, identity).map_err(Failure::input)?);
        }
        connect(address, &options, Limits::default()).await.map_err(refused)
    }
}

impl TokenArgs {
    fn read(&self) -> Outcome<Option<Token>> {
        let (secret, place) = match (&self.token_file, std::env::var_os(TOKEN_VARIABLE)) {
            (Some(path), _) => (read_secret(path)?, path.display().to_string()),
            (None, Some(value)) => (value.into_encoded_bytes(), TOKEN_VARIABLE.to_owned()),
            (None, None) => return Ok(None),
        };
        // Editors and `echo` end the line.
        let secret =
            secret.strip_suffix(b"\n").map_or(&secret[..], |line| line.strip_suffix(b"\r").unwrap_or(line));
        Token::new(secret).map(Some).map_err(|error| Failure::input(format_args!("{place}: {error}")))
    }
}

/// Returns a failure of the network or the other side, with the options that help where there are any.
pub(crate) fn peer(error: NetError) -> Failure {
    let rejected = match &error {
        NetError::Session { source: SessionError::Rejected(reject), .. } => Some(reject.code),
        _ => None,
    };
    if rejected == Some(RejectCode::CREDENTIAL) {
        return Failure::new(Exit::Peer, format_args!("{error} (--token-file or PSAO_TOKEN)"));
    }
    Failure::new(Exit::Peer, error)
}

/// Returns the failure to listen or connect, with the options that help.
fn refused(error: NetError) -> Failure {
    let options = match &error {
        NetError::Exposed { .. } => "--cert, --key and --client-ca or --token-file; --open-to-everyone",
        NetError::TlsNeeds { .. } => "--cert and --key at a server, --ca at a client",
        NetError::TlsUnused { .. } => "--cert, --key, --ca",
        NetError::TokenInClear { .. } => "--token-file or PSAO_TOKEN; --token-in-clear",
        _ => return peer(error),
    };
    Failure::usage(format_args!("{error} ({options})"))
}

fn read(path: &Path) -> Outcome<Vec<u8>> {
    std::fs::read(path).map_err(|error| Failure::reading(path, &error))
}

/// Reads a secret file, and warns when others can read it.
fn read_secret(path: &Path) -> Outcome<Vec<u8>> {
    #[cfg(unix)]
    if let Ok(metadata) = std::fs::metadata(path) {
        use std::os::unix::fs::PermissionsExt as _;
        if metadata.permissions().mode() & 0o044 != 0 {
            eprintln!("psao: warning: others can read the secret in {0}: chmod 600 {0}", path.display());
        }
    }
    read(path)
}

/// Prints to standard error which clients came and went, and what could not be served. Edits are handled elsewhere.
pub(crate) fn tell(event: &HubEvent) {
    match event {
        HubEvent::Joined { peer, name, .. } => eprintln!("{peer} joined: {name}"),
        HubEvent::Left { peer, error: None, .. } => eprintln!("{peer} left"),
        HubEvent::Left { peer, error: Some(error), .. } => eprintln!("{peer} left: {error}"),
        HubEvent::AcceptFailed { what } => eprintln!("psao: cannot accept connections at the moment: {what}"),
        HubEvent::Dropped { connections } => {
            eprintln!("psao: connections dropped since then, too many at the same time: {connections}");
        }
        HubEvent::Missed { events } => {
            eprintln!("psao: earlier messages about clients that were left out: {events}");
        }
        HubEvent::Edit { .. } => {}
    }
}

/// Waits for Ctrl-C or SIGTERM.
pub(crate) async fn stop() {
    #[cfg(unix)]
    if let Ok(mut terminate) = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        }
        return;
    }
    let _ = tokio::signal::ctrl_c().await;
}
