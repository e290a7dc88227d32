//! What happens from now on, as a recording that grows.

use super::{Door, Refusal};
use crate::recording::Setup;
use crate::recording::file::{FileError, Timed, Writer};
use axum::body::{Body, Bytes};
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::IntoResponse;
use futures_util::stream::unfold;
use serde::Deserialize;
use std::convert::Infallible;
use std::io::{self, ErrorKind, Write};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::{Sender, channel};
use utoipa::IntoParams;

/// A recording grows so often.
const EVERY: Duration = Duration::from_millis(500);
/// Pieces of so many may wait for somebody who takes them slowly.
const PIECES: usize = 8;
/// The longest that may be asked for: a week.
const SECONDS_MAX: f64 = 7.0 * 86_400.0;

#[derive(Deserialize, IntoParams)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
#[derive(Default)]
pub(super) struct Length {
    /// How long to record; until the connection is closed without it.
    seconds: Option<f64>,
}

/// Record telemetry, trackers' readings, orders and turns from now on, as an MCAP file of JSON messages that grows until it is ended
#[utoipa::path(get, path = "/recording.mcap", params(Length), responses(
    (status = 200, content_type = "application/octet-stream"), (status = 400, description = "what length is allowed"),
    (status = 503, description = "too many record")
))]
pub(super) async fn recording(
    State(door): State<Arc<Door>>,
    query: Result<Query<Length>, QueryRejection>,
) -> Result<impl IntoResponse, Refusal> {
    let Query(Length { seconds }) = query?;
    if seconds.is_some_and(|seconds| !(0.1..=SECONDS_MAX).contains(&seconds)) {
        return Err(Refusal::bad(format!("seconds: allowed is 0.1 to {SECONDS_MAX}")));
    }
    let place = Arc::clone(&door.recordings).try_acquire_owned();
    let place = place.map_err(|_| Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many record"))?;
    let until = seconds.map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
    let entries = door.hub.begin_recording(|viewers, began_unix_ns| Setup {
        began_unix_ns,
        heads: viewers.heads().clone(),
        ..door.setup.clone()
    });
    let (to, from) = channel(PIECES);
    tokio::task::spawn_blocking(move || {
        if let Err(FileError::Io(error)) = write(&door, &entries, until, Pieces { to, waiting: Vec::new() })
            && error.kind() != ErrorKind::BrokenPipe
        {
            tracing::warn!("a recording ended: {error}");
        }
        drop(place);
    });
    let pieces = unfold(from, async |mut from| from.recv().await.map(|piece| (Ok::<_, Infallible>(piece), from)));
    let headers = [
        ("content-type", "application/octet-stream"),
        ("content-disposition", "attachment; filename=\"recording.mcap\""),
    ];
    Ok((headers, Body::from_stream(pieces)))
}

/// Writes what comes until the time is over, the daemon ends, or nobody takes it any more.
fn write(door: &Door, entries: &Receiver<Arc<Timed>>, until: Option<Instant>, to: Pieces) -> Result<(), FileError> {
    let mut writer = Writer::new(to)?;
    let mut flushed_at = Instant::now();
    while !door.hub.is_stopping() && until.is_none_or(|until| Instant::now() < until) {
        match entries.recv_timeout(EVERY / 2) {
            Ok(entry) => writer.write(&entry)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if flushed_at.elapsed() >= EVERY {
            writer.flush()?;
            flushed_at = Instant::now();
        }
    }
    Ok(writer.finish()?.flush()?)
}

/// Pieces of a body.
struct Pieces {
    to: Sender<Bytes>,
    waiting: Vec<u8>,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.waiting.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let piece = Bytes::from(std::mem::take(&mut self.waiting));
        self.to.blocking_send(piece).map_err(|_| ErrorKind::BrokenPipe.into())
    }
}
