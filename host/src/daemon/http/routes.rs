//! What the interface answers.

use super::{Door, Refusal, recording, telling};
use crate::daemon::eye::{Place, eye_png, ring_png};
use crate::daemon::library::{Content, Entry, LibraryError};
use crate::daemon::telemetry::{Event, SeenViewer, Telemetry};
use crate::daemon::wish::{Mode, Wish};
use crate::link::sim::Action;
use crate::recording::{Entry as Recorded, Eye};
use axum::Json;
use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, PathRejection, QueryRejection};
use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::StatusCode;
use axum::response::IntoResponse;
use protocol::message::Command;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// The longest request but for uploads, in bytes.
pub(super) const JSON_BYTES_MAX: usize = 64 << 10;
/// The thread that talks to the controller is dead when it was silent for so long.
const DEAD: Duration = Duration::from_secs(10);
/// The side of the slice ring in pixels.
const RING_PIXELS: u32 = 480;

type Shared = State<Arc<Door>>;

/// All of them; uploads may have so many bytes.
pub(super) fn all(upload_bytes_max: usize) -> OpenApiRouter<Arc<Door>> {
    OpenApiRouter::new()
        .routes(routes!(status))
        .routes(routes!(display, change_display))
        .routes(routes!(scenes))
        .merge(OpenApiRouter::new().routes(routes!(upload, delete)).layer(DefaultBodyLimit::max(upload_bytes_max)))
        .routes(routes!(motor))
        .routes(routes!(clear_fault))
        .routes(routes!(events))
        .routes(routes!(telling::telemetry))
        .routes(routes!(recording::recording))
        .routes(routes!(eye))
        .routes(routes!(ring))
        .routes(routes!(viewers, post_viewers))
        .routes(routes!(simulate))
}

impl From<LibraryError> for Refusal {
    fn from(error: LibraryError) -> Self {
        let status = match error {
            LibraryError::Name(_) | LibraryError::Refused { .. } | LibraryError::Scene(_) => StatusCode::BAD_REQUEST,
            LibraryError::TooManyTriangles { .. } => StatusCode::PAYLOAD_TOO_LARGE,
            LibraryError::BuiltIn(_) | LibraryError::NotOwn(_) | LibraryError::InUse(_) => StatusCode::CONFLICT,
            LibraryError::Unknown(_) => StatusCode::NOT_FOUND,
            LibraryError::Full(_) => StatusCode::INSUFFICIENT_STORAGE,
            LibraryError::Io(_) => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self::new(status, error)
    }
}

impl From<BytesRejection> for Refusal {
    fn from(rejection: BytesRejection) -> Self {
        too_large(&rejection, JSON_BYTES_MAX).unwrap_or_else(|| Self::new(rejection.status(), rejection.body_text()))
    }
}

/// What to say where more than `most` bytes came.
fn too_large(rejection: &BytesRejection, most: usize) -> Option<Refusal> {
    let says = || Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, format!("too large: at most {most} bytes are allowed"));
    (rejection.status() == StatusCode::PAYLOAD_TOO_LARGE).then(says)
}

impl From<QueryRejection> for Refusal {
    fn from(rejection: QueryRejection) -> Self {
        Self::new(rejection.status(), rejection.body_text())
    }
}

impl From<PathRejection> for Refusal {
    fn from(rejection: PathRejection) -> Self {
        Self::new(rejection.status(), rejection.body_text())
    }
}

/// Work that takes a while, off the thread that answers everybody.
async fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T, Refusal> {
    let failed = |_| Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, "the work failed");
    tokio::task::spawn_blocking(work).await.map_err(failed)
}

fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, Refusal> {
    let mut json = serde_json::Deserializer::from_slice(bytes);
    let told = serde_path_to_error::deserialize(&mut json).map_err(Refusal::bad)?;
    json.end().map_err(Refusal::bad)?;
    Ok(told)
}

/// What is known and what is wished for.
#[derive(Serialize, ToSchema)]
struct Status {
    telemetry: Telemetry,
    wish: Wish,
}

/// What is known of the display, and what is wished for
#[utoipa::path(get, path = "/status", responses((status = 200, body = Status)))]
async fn status(State(door): Shared) -> Json<Status> {
    Json(Status { telemetry: door.hub.telemetry(), wish: door.hub.wish().0 })
}

/// What is wished for
#[utoipa::path(get, path = "/display", responses((status = 200, body = Wish)))]
async fn display(State(door): Shared) -> Json<Wish> {
    Json(door.hub.wish().0)
}

/// Wish for something else: a JSON merge patch (RFC 7396) of the wish
#[utoipa::path(patch, path = "/display", request_body = Wish, responses(
    (status = 200, body = Wish), (status = 400, description = "what is not allowed, and what is"), (status = 404, description = "no such scene")
))]
async fn change_display(State(door): Shared, body: Result<Bytes, BytesRejection>) -> Result<Json<Wish>, Refusal> {
    let patch: Value = read(&body?)?;
    if let Some(name) = patch.get("scene").and_then(Value::as_str) {
        door.scenes.find(name)?;
    }
    // Somebody who chooses a scene wants to see it.
    let shows = patch.get("scene").is_some() && patch.get("mode").is_none();
    let wish = door.hub.change_wish(|wish| {
        let wish = wish.patched(&patch)?;
        Ok::<_, crate::daemon::wish::WishError>(if shows { Wish { mode: Mode::Scene, ..wish } } else { wish })
    });
    Ok(Json(wish.map_err(Refusal::bad)?))
}

/// The scenes that may be wished for
#[utoipa::path(get, path = "/scenes", responses((status = 200, body = Vec<Entry>)))]
async fn scenes(State(door): Shared) -> Result<Json<Vec<Entry>>, Refusal> {
    Ok(Json(door.scenes.list()?))
}

/// Take a GLB file as a scene of this name: all of it or nothing
#[utoipa::path(put, path = "/scenes/{name}", params(("name" = String, Path, description = "letters, digits, - and _")),
    request_body(content_type = "model/gltf-binary"), responses(
    (status = 201, body = Content), (status = 400, description = "why it is no scene"), (status = 409, description = "the name is taken"),
    (status = 413, description = "too large"), (status = 507, description = "the scene folder is full")
))]
async fn upload(
    State(door): Shared,
    name: Result<Path<String>, PathRejection>,
    body: Result<Bytes, BytesRejection>,
) -> Result<impl IntoResponse, Refusal> {
    let Path(name) = name?;
    let bytes = match body {
        Err(rejection) if let Some(refusal) = too_large(&rejection, door.upload_bytes_max) => return Err(refusal),
        body => body?,
    };
    let _turn = door.uploads.acquire().await.map_err(Refusal::bad)?;
    let shared = Arc::clone(&door);
    let content = aside(move || shared.scenes.upload(&name, &bytes)).await??;
    Ok((StatusCode::CREATED, Json(content)))
}

/// Remove an uploaded scene
#[utoipa::path(delete, path = "/scenes/{name}", params(("name" = String, Path)), responses(
    (status = 204), (status = 404, description = "no such scene"), (status = 409, description = "it is on the display, or built in")
))]
async fn delete(State(door): Shared, name: Result<Path<String>, PathRejection>) -> Result<StatusCode, Refusal> {
    let Path(name) = name?;
    if door.hub.wish().0.scene == name && door.scenes.is_own(&name)? {
        return Err(LibraryError::InUse(name).into());
    }
    door.scenes.delete(&name)?;
    Ok(StatusCode::NO_CONTENT)
}

/// What the motor is to do.
#[derive(Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum MotorOrder {
    /// Spin up and lock.
    Start,
    /// Go dark and run out.
    Stop,
}

/// Start or stop the mirror
#[utoipa::path(post, path = "/motor/{order}", params(("order" = MotorOrder, Path)), responses((status = 200, body = Wish)))]
async fn motor(State(door): Shared, order: Result<Path<MotorOrder>, PathRejection>) -> Result<Json<Wish>, Refusal> {
    let motor = matches!(order?.0, MotorOrder::Start);
    if !motor {
        door.hub.order(Command::Stop);
    }
    let wish = door.hub.change_wish(|wish| Ok(Wish { motor, ..wish.clone() }));
    wish.map(Json).map_err(|never: std::convert::Infallible| match never {})
}

/// Clear the controller's fault, if its cause is gone. After an emergency stop or an open guard the mirror waits for a start
#[utoipa::path(post, path = "/faults/clear", responses((status = 202)))]
async fn clear_fault(State(door): Shared) -> StatusCode {
    door.hub.order(Command::ClearFault);
    StatusCode::ACCEPTED
}

#[derive(Deserialize, IntoParams)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
#[derive(Default)]
struct After {
    /// Only events with a larger number.
    after: u64,
}

/// What happened: faults, scenes, the controller coming and going; the oldest first
#[utoipa::path(get, path = "/events", params(After), responses((status = 200, body = Vec<Event>)))]
async fn events(State(door): Shared, query: Result<Query<After>, QueryRejection>) -> Result<Json<Vec<Event>>, Refusal> {
    Ok(Json(door.hub.events_after(query?.after)))
}

/// What an eye at a place sees of the turn on screen; dark where nothing is lit
#[utoipa::path(get, path = "/eye.png", params(Place), responses((status = 200, content_type = "image/png")))]
async fn eye(State(door): Shared, query: Result<Query<Place>, QueryRejection>) -> Result<impl IntoResponse, Refusal> {
    let Query(place) = query?;
    place.check().map_err(Refusal::bad)?;
    let _turn = door.pictures.acquire().await.map_err(Refusal::bad)?;
    let shared = Arc::clone(&door);
    let png = aside(move || {
        let turn = shared.hub.on_screen();
        eye_png(&shared.rig, turn.as_deref(), &place, shared.display_radius_m)
    });
    Ok(([("content-type", "image/png"), ("cache-control", "no-store")], png.await?))
}

/// Some of the slices of the turn on screen, on a ring by mirror angle
#[utoipa::path(get, path = "/ring.png", responses((status = 200, content_type = "image/png")))]
async fn ring(State(door): Shared) -> Result<impl IntoResponse, Refusal> {
    let _turn = door.pictures.acquire().await.map_err(Refusal::bad)?;
    let shared = Arc::clone(&door);
    let png = aside(move || ring_png(shared.hub.on_screen().as_deref(), RING_PIXELS)).await?;
    Ok(([("content-type", "image/png"), ("cache-control", "no-store")], png))
}

/// Somebody who looks, as another program knows it.
#[derive(Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct PostedViewer {
    /// Which of them: 0 to 255.
    id: u8,
    /// The middle between the eyes, world metres: to the display's right, up, to the front.
    position_m: [f64; 3],
    /// How long ago that was, in seconds: 0 to 1.
    #[serde(default)]
    age_s: f64,
}

/// Viewers who are posted have numbers from here on: trackers have those below.
const POSTED: u16 = 2048;

/// Who is tracked, where they are expected to be when the light leaves
#[utoipa::path(get, path = "/viewers", responses((status = 200, body = Vec<SeenViewer>)))]
async fn viewers(State(door): Shared) -> Json<Vec<SeenViewer>> {
    Json(door.hub.telemetry().viewers)
}

/// Tell where viewers are; who is not told of for a second has gone
#[utoipa::path(post, path = "/viewers", request_body = Vec<PostedViewer>, responses(
    (status = 202), (status = 400, description = "who cannot be there, and why; the others are taken")
))]
async fn post_viewers(State(door): Shared, body: Result<Bytes, BytesRejection>) -> Result<StatusCode, Refusal> {
    let posted: Vec<PostedViewer> = read(&body?)?;
    let now = door.hub.start().elapsed();
    let mut refused = Vec::new();
    for PostedViewer { id, position_m, age_s } in posted {
        if !(0.0..=1.0).contains(&age_s) {
            refused.push(format!("viewer {id}: age_s = {age_s}: allowed is 0 to 1"));
            continue;
        }
        let at = now.saturating_sub(Duration::from_secs_f64(age_s));
        let taken = door.hub.arrive_eye(Eye { id: POSTED + u16::from(id), position_m: position_m.into(), at });
        if let Err(reason) = taken {
            refused.push(format!("viewer {id} at {position_m:?} is refused: {}", door.why(reason)));
        }
    }
    if refused.is_empty() { Ok(StatusCode::ACCEPTED) } else { Err(Refusal::bad(refused.join("; "))) }
}

/// Let something happen to a simulated controller: an action as scenario files have it, such as "emergency-stop"
#[utoipa::path(post, path = "/simulator", request_body = Value, responses(
    (status = 202), (status = 404, description = "the controller is no simulated one")
))]
async fn simulate(State(door): Shared, body: Result<Bytes, BytesRejection>) -> Result<StatusCode, Refusal> {
    let Some(injector) = &door.injector else {
        return Err(Refusal::new(StatusCode::NOT_FOUND, "the controller is no simulated one"));
    };
    let told: Value = read(&body?)?;
    let action: Action = serde_path_to_error::deserialize(&told).map_err(Refusal::bad)?;
    action.check("do").map_err(Refusal::bad)?;
    door.hub.record(|| Recorded::Action(told));
    injector.inject(action);
    Ok(StatusCode::ACCEPTED)
}

/// Figures for Prometheus
pub(super) async fn metrics(State(door): Shared) -> impl IntoResponse {
    ([("content-type", "application/openmetrics-text; version=1.0.0; charset=utf-8")], door.hub.metrics.text())
}

/// Whether the daemon is alive
pub(super) async fn health(State(door): Shared) -> impl IntoResponse {
    let silent = door.hub.silent_for();
    let alive = silent < DEAD;
    let status = if alive { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
    (status, Json(json!({ "alive": alive, "silent_s": silent.as_secs_f64() })))
}
