//! Telemetry and events to whoever listens, as server-sent events.

use super::{Door, Refusal};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures_util::stream::{Stream, unfold};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::OwnedSemaphorePermit;

/// How often telemetry is told.
const EVERY: Duration = Duration::from_millis(100);

/// One who listens.
struct Listener {
    door: Arc<Door>,
    /// The last event that was told.
    told: u64,
    /// The version of the wish that was told.
    wish: Option<u64>,
    waiting: VecDeque<Event>,
    _place: OwnedSemaphorePermit,
}

/// Telemetry ten times a second as `telemetry`, what happened as `event`, with its number as identifier, what is wished for as `wish`
#[utoipa::path(get, path = "/telemetry", responses(
    (status = 200, content_type = "text/event-stream", description = "events `telemetry` (Telemetry), `event` (Event) and `wish` (Wish, where it changed)"),
    (status = 503, description = "too many listen")
))]
pub(super) async fn telemetry(
    State(door): State<Arc<Door>>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Refusal> {
    let place = Arc::clone(&door.listeners).try_acquire_owned();
    let place = place.map_err(|_| Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many listen"))?;
    let last = headers.get("last-event-id").and_then(|value| value.to_str().ok());
    let told = last.and_then(|number| number.parse().ok()).unwrap_or(0);
    let listener = Listener { door, told, wish: None, waiting: VecDeque::new(), _place: place };
    Ok(Sse::new(unfold(listener, next)).keep_alive(KeepAlive::default()))
}

async fn next(mut listener: Listener) -> Option<(Result<Event, Infallible>, Listener)> {
    while listener.waiting.is_empty() {
        tokio::time::sleep(EVERY).await;
        if listener.door.hub.is_stopping() {
            return None;
        }
        let (wish, version) = listener.door.hub.wish();
        if listener.wish.replace(version) != Some(version) {
            listener.waiting.extend(Event::default().event("wish").json_data(&wish).ok());
        }
        for event in listener.door.hub.events_after(listener.told) {
            listener.told = event.number;
            let message = Event::default().event("event").id(event.number.to_string());
            listener.waiting.extend(message.json_data(&event).ok());
        }
        let message = Event::default().event("telemetry").json_data(listener.door.hub.telemetry());
        listener.waiting.extend(message.ok());
    }
    let event = listener.waiting.pop_front()?;
    Some((Ok(event), listener))
}
