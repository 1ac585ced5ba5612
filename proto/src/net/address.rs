//! Addresses of servers.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Address of a server, written `host:port`, `tls:host:port` or `unix:PATH`.
///
/// ```
/// use psao_proto::net::Address;
///
/// let address: Address = "tls:[::1]:4700".parse()?;
/// assert!(matches!(&address, Address::Tls(place) if place.host == "::1" && place.port == 4700));
/// assert_eq!(address.to_string(), "tls:[::1]:4700");
/// assert!("localhost".parse::<Address>().unwrap_err().to_string().contains("host:port"));
/// # Ok::<(), psao_proto::net::AddressError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Plain TCP.
    Tcp(HostPort),
    /// TLS over TCP.
    Tls(HostPort),
    /// A Unix socket: a file that only its owner can use.
    Unix(PathBuf),
}

/// A host and a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostPort {
    /// Name or IP address, without the brackets of IPv6.
    pub host: String,
    /// Port; at a listener, 0 lets the system choose.
    pub port: u16,
}

/// Why a text is not an address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} is not an address: {problem}; an address is host:port (127.0.0.1:4700, [::1]:4700), tls:host:port or unix:PATH"
)]
pub struct AddressError {
    text: String,
    problem: &'static str,
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let parsed = if let Some(path) = text.strip_prefix("unix:") {
            if path.is_empty() { Err("the path is missing") } else { Ok(Self::Unix(path.into())) }
        } else if let Some(place) = text.strip_prefix("tls:") {
            host_port(place).map(Self::Tls)
        } else {
            host_port(text).map(Self::Tcp)
        };
        parsed.map_err(|problem| AddressError { text: text.to_owned(), problem })
    }
}

fn host_port(text: &str) -> Result<HostPort, &'static str> {
    let (host, port) = text.rsplit_once(':').ok_or("the port is missing")?;
    let host = match host.strip_prefix('[').map(|rest| rest.strip_suffix(']')) {
        Some(Some(inside)) => inside,
        Some(None) => return Err("the bracket is not closed"),
        None if host.contains(':') => return Err("an IPv6 address must be in brackets"),
        None => host,
    };
    if host.is_empty() {
        return Err("the host is missing");
    }
    let port = port.parse().map_err(|_| "the port is not a number from 0 to 65535")?;
    Ok(HostPort { host: host.to_owned(), port })
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(place) => write!(f, "{place}"),
            Self::Tls(place) => write!(f, "tls:{place}"),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "[{}]:{}", self.host, self.port),
            false => write!(f, "{}:{}", self.host, self.port),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_written_as_they_are_read() {
        for text in
            ["127.0.0.1:4700", "localhost:0", "[::1]:65535", "tls:render-7.local:443", "unix:/run/a b"]
        {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_address_is_told_why() {
        for (text, problem) in [
            ("", "the port is missing"),
            ("no port here", "the port is missing"),
            (":4700", "the host is missing"),
            ("a:65536", "not a number"),
            ("http://a", "not a number"),
            ("::1:4700", "brackets"),
            ("[::1:4700", "not closed"),
            ("tls:a", "the port is missing"),
            ("unix:", "the path is missing"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(problem) && error.contains("tls:host:port"), "{error}");
        }
    }
}
