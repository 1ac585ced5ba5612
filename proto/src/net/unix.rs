//! Unix sockets: files that only their owner may use, and that remain when a server is killed.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tokio::net::{UnixListener, UnixSocket, UnixStream};

use super::{Address, NetError, Peer};

/// Connections that may wait to be accepted.
const BACKLOG: u32 = 1024;

/// A listener and its file.
#[derive(Debug)]
pub(super) struct UnixSocketListener {
    listener: UnixListener,
    _file: SocketFile,
}

impl UnixSocketListener {
    pub(super) async fn bind(path: &Path) -> Result<Self, NetError> {
        let refused = |source| NetError::bind(&Address::Unix(path.to_owned()), source);
        let socket = match bind(path) {
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                remove_stale(path).await?;
                bind(path)
            }
            other => other,
        }
        .map_err(refused)?;
        let file = SocketFile::new(path).map_err(refused)?;
        // Nobody can connect before the socket listens, so its permissions are never too wide.
        fs::set_permissions(path, fs::Permissions::from_mode(0o600)).map_err(refused)?;
        let listener = socket.listen(BACKLOG).map_err(refused)?;
        Ok(Self { listener, _file: file })
    }

    pub(super) async fn accept(&self) -> io::Result<(UnixStream, Peer)> {
        let (stream, _) = self.listener.accept().await?;
        let process = stream.peer_cred().ok().and_then(|peer| peer.pid());
        Ok((stream, Peer::Unix { process }))
    }
}

fn bind(path: &Path) -> io::Result<UnixSocket> {
    let socket = UnixSocket::new_stream()?;
    socket.bind(path)?;
    Ok(socket)
}

/// Removes a socket that a killed server left behind. Refuses to remove other files and sockets in use.
async fn remove_stale(path: &Path) -> Result<(), NetError> {
    let address = Address::Unix(path.to_owned());
    let metadata = fs::symlink_metadata(path).map_err(|source| NetError::bind(&address, source))?;
    if !metadata.file_type().is_socket() {
        return Err(NetError::NotASocket { path: path.to_owned() });
    }
    match UnixStream::connect(path).await {
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|source| NetError::bind(&address, source))
        }
        _ => Err(NetError::InUse { address: address.to_string() }),
    }
}

/// The file of a bound socket. Dropping this value removes the file, unless another file has replaced it.
#[derive(Debug)]
struct SocketFile {
    path: PathBuf,
    identity: (u64, u64),
}

impl SocketFile {
    fn new(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), identity: identity(path)? })
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|found| found == self.identity) {
            // If this fails, the next server replaces the stale file.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    let metadata = fs::symlink_metadata(path)?;
    Ok((metadata.dev(), metadata.ino()))
}
