//! `psao keys`: certificates and a token to try a network with.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};

use crate::context::say;
use crate::error::{Exit, Failure, Outcome};

/// Create certificates and a token for encrypted connections
///
/// Creates an authority, and certificates for a server and a client. They are meant for trials and closed groups. Anyone
/// with authority.key can make certificates that the whole group trusts: keep it off the servers, or delete it. Existing
/// files are never overwritten.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:
  psao keys trial --name localhost --name render-7.local")]
pub(crate) struct Args {
    /// Folder to write to; created if missing
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Name or IP address by which clients reach the server; repeat it for more [default: localhost and its addresses]
    #[arg(long = "name", value_name = "NAME", hide_default_value = true, default_values = ["localhost", "127.0.0.1", "::1"])]
    names: Vec<String>,
    /// Days for which the certificates are valid
    #[arg(long, value_name = "N", default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
}

/// A clock that is a little behind must not find a certificate that is not valid yet.
const BACKDATED: Duration = Duration::from_secs(3600);
/// Random bytes of a token; the file has them in hexadecimal digits.
const TOKEN_BYTES: usize = 32;

/// A file, its text, and whether it is a secret.
type Made = (&'static str, String, bool);

pub(crate) fn run(args: &Args) -> Outcome {
    let made =
        make(args).map_err(|error| Failure::usage(format_args!("cannot make the certificates: {error}")))?;
    let token = token()?;
    let files = made.into_iter().chain([("token", token, true)]);
    std::fs::create_dir_all(&args.folder).map_err(|error| Failure::writing(&args.folder, &error))?;
    let files: Vec<_> = files.map(|(name, text, secret)| (args.folder.join(name), text, secret)).collect();
    if let Some((path, ..)) = files.iter().find(|(path, ..)| path.symlink_metadata().is_ok()) {
        return Err(Failure::input(format_args!(
            "{} exists and is not overwritten: choose another folder, or remove it",
            path.display()
        )));
    }
    for (path, text, secret) in &files {
        write(path, text, *secret).map_err(|error| Failure::writing(path, &error))?;
        say(format_args!("wrote {}{}", path.display(), if *secret { " (keep it secret)" } else { "" }))?;
    }
    explain(args)
}

fn make(args: &Args) -> Result<Vec<Made>, rcgen::Error> {
    let key = KeyPair::generate()?;
    let mut params = params(args, &[])?;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params.distinguished_name.push(DnType::CommonName, "psao trial authority");
    let authority = params.self_signed(&key)?.pem();
    let authority_key = key.serialize_pem();
    let issuer = Issuer::new(params, key);
    let (server, server_key) = signed(args, &args.names, ExtendedKeyUsagePurpose::ServerAuth, &issuer)?;
    let (client, client_key) = signed(args, &[], ExtendedKeyUsagePurpose::ClientAuth, &issuer)?;
    Ok(vec![
        ("authority.pem", authority, false),
        ("authority.key", authority_key, true),
        ("server.pem", server, false),
        ("server.key", server_key, true),
        ("client.pem", client, false),
        ("client.key", client_key, true),
    ])
}

/// Returns a certificate and its key.
fn signed(
    args: &Args,
    names: &[String],
    usage: ExtendedKeyUsagePurpose,
    issuer: &Issuer<'_, KeyPair>,
) -> Result<(String, String), rcgen::Error> {
    let mut params = params(args, names)?;
    let role = if usage == ExtendedKeyUsagePurpose::ServerAuth { "psao server" } else { "psao client" };
    params.distinguished_name.push(DnType::CommonName, role);
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![usage];
    params.use_authority_key_identifier_extension = true;
    let key = KeyPair::generate()?;
    Ok((params.signed_by(&key, issuer)?.pem(), key.serialize_pem()))
}

fn params(args: &Args, names: &[String]) -> Result<CertificateParams, rcgen::Error> {
    let mut params = CertificateParams::new(names)?;
    params.distinguished_name = rcgen::DistinguishedName::new();
    let now = SystemTime::now();
    params.not_before = (now - BACKDATED).into();
    params.not_after = (now + Duration::from_secs(u64::from(args.days) * 24 * 3600)).into();
    Ok(params)
}

fn token() -> Outcome<String> {
    let mut random = [0; TOKEN_BYTES];
    getrandom::fill(&mut random).map_err(|error| {
        Failure::new(Exit::System, format_args!("the system gives no random bytes: {error}"))
    })?;
    Ok(random.iter().map(|byte| format!("{byte:02x}")).chain(["\n".to_owned()]).collect())
}

/// Writes a new file; only its owner can read a secret.
fn write(path: &Path, text: &str, secret: bool) -> std::io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if secret {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    options.open(path)?.write_all(text.as_bytes())
}

fn explain(args: &Args) -> Outcome {
    let folder = args.folder.display();
    let name = args.names.first().map_or("localhost", String::as_str);
    let host = if name.contains(':') { format!("[{name}]") } else { name.to_owned() };
    say(format_args!(
        "\nA server, in one terminal, and a client, in another:\n\n  \
         psao serve --scene colonnade --listen tls:{host}:4700 --cert {folder}/server.pem --key {folder}/server.key \
         --client-ca {folder}/authority.pem --token-file {folder}/token\n  \
         psao client tls:{host}:4700 --ca {folder}/authority.pem --cert {folder}/client.pem --key {folder}/client.key \
         --token-file {folder}/token"
    ))
}
