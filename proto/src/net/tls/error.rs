//! TLS errors, with messages for users.

use std::io;

use tokio_rustls::rustls::{AlertDescription, CertificateError, Error};

/// Why a TLS handshake or connection failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TlsError {
    /// This end refused the other end's certificate.
    #[error("the other end's certificate {0}")]
    PeerCertificate(TlsCertificateError),
    /// The other end refused this end's certificate.
    #[error("the other end refused this end's certificate: it {0}")]
    OwnCertificate(TlsCertificateError),
    /// The other end does not speak TLS.
    #[error("the other end does not speak TLS: it is another program, or is not set up for it")]
    NotTls,
    /// The other end closed the connection during the handshake.
    #[error("the other end closed the connection during the TLS handshake: does it speak TLS?")]
    Closed,
    /// Another TLS error.
    #[error("TLS failed: {0}")]
    Other(Error),
}

/// Why a certificate was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TlsCertificateError {
    /// It has expired or is not valid yet.
    #[error("has expired or is not valid yet: check the clocks of both ends, or make a new one")]
    Expired,
    /// It belongs to another host.
    #[error(
        "is not valid for the name {expected}, but for {presented}: connect by one of those, or make one with that name"
    )]
    WrongName {
        /// Name of the host that the client connected to.
        expected: String,
        /// Names in the certificate.
        presented: String,
    },
    /// No trusted authority has signed it.
    #[error(
        "is signed by an authority that is not trusted: give both ends the certificate of the same authority"
    )]
    UnknownAuthority,
    /// The client presented none.
    #[error("is missing: the server takes only clients that show one")]
    Missing,
    /// It was refused for another reason.
    #[error("is not acceptable: {0}")]
    Other(String),
}

impl TlsError {
    /// Returns the TLS error within a socket error, if there is one.
    pub(crate) fn of(error: &io::Error) -> Option<Self> {
        error.get_ref().and_then(|inner| inner.downcast_ref::<Error>()).map(|inner| Self::from(inner.clone()))
    }

    /// Returns the TLS error within a socket error of the handshake, if there is one.
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
            // `BadSignature` means another authority of the same name.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => Self::UnknownAuthority,
            other => Self::Other(other.to_string()),
        }
    }
}

/// Returns the certificate error that an alert reports (RFC 8446, 6.2).
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
