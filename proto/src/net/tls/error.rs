//! What goes wrong between two ends that speak TLS, or of which only one does.

use std::io;

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

/// Why TLS could not be set up, or broke.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TlsError {
    /// This end refuses the other's certificate.
    #[error("the other end's certificate {0}")]
    PeerCertificate(TlsCertificateError),
    /// The other end refuses this end's certificate.
    #[error("the other end refused this end's certificate: it {0}")]
    OwnCertificate(TlsCertificateError),
    /// The other end speaks something else.
    #[error("the other end does not speak TLS: it is another program, or was not certificate_error_of to")]
    NotTls,
    /// The other end went away before the connection was set up.
    #[error("the other end closed the connection during the TLS handshake: does it speak TLS?")]
    Closed,
    /// Anything else.
    #[error("TLS failed: {0}")]
    Other(Error),
}

/// What is wrong with a certificate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TlsCertificateError {
    /// It has expired or is not valid yet.
    #[error("has expired or is not valid yet: check the clocks of both ends, or make a new one")]
    Expired,
    /// It is of another host.
    #[error(
        "is not valid for the name {expected}, but for {presented}: connect by one of those, or make one with that name"
    )]
    WrongName {
        /// The name that was connected to.
        expected: String,
        /// The names in it.
        presented: String,
    },
    /// No authority that is trusted has signed it.
    #[error(
        "is signed by an authority that is not trusted: give both ends the certificate of the same authority"
    )]
    UnknownAuthority,
    /// There is none.
    #[error("is missing: the server takes only clients that show one")]
    Missing,
    /// It was refused, and all that is known is how.
    #[error("is not acceptable: {0}")]
    Other(String),
}

impl TlsError {
    /// Returns the TLS error in an error of a socket, if it is one.
    pub(crate) fn of(error: &io::Error) -> Option<Self> {
        error.get_ref().and_then(|inner| inner.downcast_ref::<Error>()).map(|inner| Self::from(inner.clone()))
    }

    /// Returns the TLS error in an error during the handshake.
    pub(crate) fn of_handshake(error: &io::Error) -> Option<Self> {
        let closed =
            [io::ErrorKind::UnexpectedEof, io::ErrorKind::ConnectionReset, io::ErrorKind::BrokenPipe];
        Self::of(error).or_else(|| closed.contains(&error.kind()).then_some(Self::Closed))
    }
}

impl From<Error> for TlsError {
    fn from(error: Error) -> Self {
        match error {
            Error::InvalidCertificate(problem) => Self::PeerCertificate(problem.into()),
            Error::NoCertificatesPresented => Self::PeerCertificate(TlsCertificateError::Missing),
            Error::InvalidMessage(_) => Self::NotTls,
            Error::AlertReceived(alert) => match certificate_error_of(alert) {
                Some(problem) => Self::OwnCertificate(problem),
                None => Self::Other(error),
            },
            other => Self::Other(other),
        }
    }
}

impl From<CertificateError> for TlsCertificateError {
    fn from(error: CertificateError) -> Self {
        match error {
            CertificateError::Expired
            | CertificateError::ExpiredContext { .. }
            | CertificateError::NotValidYet
            | CertificateError::NotValidYetContext { .. } => Self::Expired,
            CertificateError::NotValidForNameContext { expected, presented } => Self::WrongName {
                expected: expected.to_str().into_owned(),
                presented: if presented.is_empty() { "none".to_owned() } else { presented.join(", ") },
            },
            // The latter: by another authority of the same name.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => Self::UnknownAuthority,
            other => Self::Other(other.to_string()),
        }
    }
}

/// What an alert says about this end's certificate (RFC 8446, 6.2).
fn certificate_error_of(alert: AlertDescription) -> Option<TlsCertificateError> {
    Some(match alert {
        AlertDescription::CertificateExpired => TlsCertificateError::Expired,
        AlertDescription::UnknownCA | AlertDescription::DecryptError => TlsCertificateError::UnknownAuthority,
        AlertDescription::CertificateRequired => TlsCertificateError::Missing,
        AlertDescription::BadCertificate => TlsCertificateError::Other("its names may be wrong".to_owned()),
        AlertDescription::UnsupportedCertificate
        | AlertDescription::CertificateRevoked
        | AlertDescription::CertificateUnknown => TlsCertificateError::Other(format!("{alert:?}")),
        _ => return None,
    })
}
