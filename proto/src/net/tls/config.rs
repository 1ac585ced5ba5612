//! Certificates and keys of both ends.

use std::fmt;
use std::sync::Arc;

use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{ClientConfig, Error, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, TlsConnector};

/// Protocol name in the TLS handshake (RFC 7301): an end that offers only other protocols is refused there.
const PROTOCOL: &[u8] = b"psao";

const CERTIFICATE: &str = "certificate";
const KEY: &str = "private key";
const AUTHORITY: &str = "authority's certificate";

/// Why certificates and keys cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TlsConfigError {
    /// The text is not PEM, or holds no item of the expected kind.
    #[error("there is no {what} in the PEM text that was given for it: {source}")]
    Pem {
        /// The expected kind.
        what: &'static str,
        /// Error of the PEM parser.
        source: pem::Error,
    },
    /// The certificate or key is present but cannot be used.
    #[error("the {what} cannot be used: {source}")]
    Unusable {
        /// The kind of item.
        what: &'static str,
        /// Why.
        source: Error,
    },
    /// The key belongs to another certificate.
    #[error("the private key does not belong to the certificate: give the two that were made together")]
    OtherKey,
}

/// A server's certificate and key, and the authorities for client certificates.
#[derive(Clone)]
pub struct ServerTls {
    acceptor: TlsAcceptor,
    requires_client_certificates: bool,
}

impl ServerTls {
    /// Reads PEM texts: the server's certificate chain, its own certificate first, its private key, and optionally the
    /// authorities that sign client certificates. With `client_authorities` every client must present such a
    /// certificate.
    ///
    /// # Errors
    /// [`TlsConfigError`] when an item is missing or unusable, or when certificate and key do not match.
    pub fn from_pem(
        certificates: &[u8],
        key: &[u8],
        client_authorities: Option<&[u8]>,
    ) -> Result<Self, TlsConfigError> {
        let builder = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(unusable(CERTIFICATE))?;
        let builder = match client_authorities {
            None => builder.with_no_client_auth(),
            Some(pem) => {
                let roots = Arc::new(roots(pem)?);
                let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider())
                    .build()
                    .map_err(|e| unusable(AUTHORITY)(Error::General(e.to_string())))?;
                builder.with_client_cert_verifier(verifier)
            }
        };
        let mut config =
            builder.with_single_cert(chain(certificates)?, private_key(key)?).map_err(pair_error)?;
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        let requires_client_certificates = client_authorities.is_some();
        Ok(Self { acceptor: TlsAcceptor::from(Arc::new(config)), requires_client_certificates })
    }

    /// Returns whether clients must present a certificate.
    #[must_use]
    pub const fn requires_client_certificates(&self) -> bool {
        self.requires_client_certificates
    }

    pub(in crate::net) const fn acceptor(&self) -> &TlsAcceptor {
        &self.acceptor
    }
}

/// The authorities that a client trusts, and optionally its own certificate and key.
#[derive(Clone)]
pub struct ClientTls {
    connector: TlsConnector,
}

impl ClientTls {
    /// Reads PEM texts: the authorities that sign server certificates, and optionally the client's certificate chain
    /// and private key, for servers that require them.
    ///
    /// # Errors
    /// As [`ServerTls::from_pem`].
    pub fn from_pem(authorities: &[u8], identity: Option<(&[u8], &[u8])>) -> Result<Self, TlsConfigError> {
        let builder = ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(unusable(CERTIFICATE))?
            .with_root_certificates(roots(authorities)?);
        let mut config = match identity {
            None => builder.with_no_client_auth(),
            Some((certificates, key)) => {
                builder.with_client_auth_cert(chain(certificates)?, private_key(key)?).map_err(pair_error)?
            }
        };
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        Ok(Self { connector: TlsConnector::from(Arc::new(config)) })
    }

    pub(in crate::net) const fn connector(&self) -> &TlsConnector {
        &self.connector
    }
}

// The output omits the contents, which include private keys.
impl fmt::Debug for ServerTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ServerTls")
            .field("requires_client_certificates", &self.requires_client_certificates)
            .finish_non_exhaustive()
    }
}

impl fmt::Debug for ClientTls {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClientTls").finish_non_exhaustive()
    }
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn unusable(what: &'static str) -> impl Fn(Error) -> TlsConfigError {
    move |source| TlsConfigError::Unusable { what, source }
}

fn pair_error(source: Error) -> TlsConfigError {
    match source {
        Error::InconsistentKeys(_) => TlsConfigError::OtherKey,
        source => unusable("certificate with its private key")(source),
    }
}

fn chain(pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, TlsConfigError> {
    certificates(CERTIFICATE, pem)
}

fn roots(pem: &[u8]) -> Result<RootCertStore, TlsConfigError> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(AUTHORITY, pem)? {
        roots.add(certificate).map_err(unusable(AUTHORITY))?;
    }
    Ok(roots)
}

/// Returns all certificates of a PEM text, at least one.
fn certificates(what: &'static str, pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, TlsConfigError> {
    let all = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>();
    match all {
        Ok(all) if all.is_empty() => Err(TlsConfigError::Pem { what, source: pem::Error::NoItemsFound }),
        Ok(all) => Ok(all),
        Err(source) => Err(TlsConfigError::Pem { what, source }),
    }
}

fn private_key(pem: &[u8]) -> Result<PrivateKeyDer<'static>, TlsConfigError> {
    PrivateKeyDer::from_pem_slice(pem).map_err(|source| TlsConfigError::Pem { what: KEY, source })
}
