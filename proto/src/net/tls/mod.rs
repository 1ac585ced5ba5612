//! TLS over TCP by `rustls` with the `ring` provider. TLS 1.3 is preferred, TLS 1.2 is accepted.
//!
//! Certificates and keys are given as PEM text. There are no built-in authorities: a client trusts only the authorities
//! that it is given.

mod config;
mod error;

pub use config::{ClientTls, ServerTls, TlsConfigError};
pub use error::{TlsCertificateError, TlsError};
