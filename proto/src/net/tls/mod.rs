//! TLS over TCP, by `rustls` with the `ring` provider: TLS 1.3, or 1.2 with those that have no better.
//!
//! Certificates and keys come in as PEM text; where it lies is the caller's business. There are no built-in authorities:
//! a client trusts those that it is given and no others.

mod config;
mod error;

pub use config::{ClientTls, ServerTls, TlsConfigError};
pub use error::{TlsCertificateError, TlsError};
