//! Who may come in, and for how long.

use super::{Door, Refusal};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use subtle::ConstantTimeEq;

/// An answer may take this long, with the reading of what was sent.
const LONGEST: Duration = Duration::from_secs(120);

/// Refuses those who may not come in; counts and logs what is refused, here or later.
pub(super) async fn guard(State(door): State<Arc<Door>>, request: Request, next: Next) -> Response {
    let path = request.uri().path().chars().take(200).collect::<String>();
    let method = request.method().clone();
    let response = match check(&door, request.uri().path(), request.headers()) {
        Err((reason, refusal)) => {
            door.hub.metrics.refused.get_or_create(&[("reason", reason)]).inc();
            refusal.into_response()
        }
        Ok(()) => {
            let answer = tokio::time::timeout(LONGEST, next.run(request)).await;
            let response = answer.unwrap_or_else(|_| {
                Refusal::new(StatusCode::REQUEST_TIMEOUT, "what was sent did not arrive in time").into_response()
            });
            if response.status().is_client_error() || response.status().is_server_error() {
                door.hub.metrics.refused.get_or_create(&[("reason", "request")]).inc();
            }
            response
        }
    };
    if response.status().is_client_error() || response.status().is_server_error() {
        tracing::warn!(%method, path, status = response.status().as_u16(), "refused a request");
    }
    response
}

fn check(door: &Door, path: &str, headers: &HeaderMap) -> Result<(), (&'static str, Refusal)> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let host = text(header::HOST).unwrap_or_default();
    // A page from elsewhere must not give orders through somebody's browser.
    if let Some(origin) = text(header::ORIGIN)
        && origin.split_once("://").is_none_or(|(_, authority)| authority != host)
    {
        return Err(("origin", Refusal::new(StatusCode::FORBIDDEN, "a page of another origin may not ask")));
    }
    let Some(token) = &door.token else {
        // Without a token whoever is on this machine may come in, but no name that somebody else's server gave to this address.
        let is_known = is_loopback(host) || host == door.listen.to_string();
        let refusal = || Refusal::new(StatusCode::FORBIDDEN, format!("ask for http://{}", door.listen));
        return if is_known { Ok(()) } else { Err(("host", refusal())) };
    };
    if super::page::is_part(path) || path == "/healthz" {
        return Ok(());
    }
    // The scheme's name has no case: RFC 9110, 11.1.
    let given = text(header::AUTHORIZATION).and_then(|value| value.split_once(' '));
    let given = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer")).map_or("", |(_, token)| token);
    if given.as_bytes().ct_eq(token.as_bytes()).into() {
        return Ok(());
    }
    let reason = "the token is missing or wrong: send Authorization: Bearer TOKEN, from the file token_file names";
    Err(("token", Refusal::new(StatusCode::UNAUTHORIZED, reason)))
}

/// Whether `host`, with a port or without, is this machine by any of its own names.
fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']').map_or("", |(address, _)| address),
        None => host.split_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_this_machine_are_known() {
        for host in ["localhost", "localhost:7117", "127.0.0.1:80", "127.1.2.3", "[::1]:7117", "[::1]", "LOCALHOST"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in [
            "",
            "example.org",
            "localhost.example.org",
            "192.168.0.2:7117",
            "[fe80::1]:1",
            "127.0.0.1.example.org",
            "[",
        ] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
