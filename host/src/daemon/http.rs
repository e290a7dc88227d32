//! The daemon's door: page, interface, figures.

mod guard;
mod page;
mod recording;
mod routes;
mod telling;

use super::eye::Place;
use super::hub::Hub;
use super::library::Library;
use crate::link::sim::Injector;
use crate::recording::Setup;
use crate::tracking;
use crate::tracking::viewers::VIEWERS_MAX;
use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router};
use protocol::rig::{Rig, Tracking};
use serde_json::json;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;

/// How often the door looks whether the daemon ends.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// After the daemon's end answers that are under way may take this long.
const LINGER: Duration = Duration::from_secs(2);
/// Pages that are told at the same time.
const LISTENERS: usize = 64;
/// Recordings that are made at the same time.
const RECORDINGS: usize = 4;

/// What answers need.
pub struct Door {
    /// What all threads know.
    pub hub: Arc<Hub>,
    /// The rig.
    pub rig: Arc<Rig>,
    /// The scenes.
    pub scenes: Arc<Library>,
    /// A way to let things happen to a simulated controller; nothing for a real one.
    pub injector: Option<Injector>,
    /// What requests must carry.
    pub token: Option<String>,
    /// The address on which the door is.
    pub listen: SocketAddr,
    /// The largest upload in bytes.
    pub upload_bytes_max: usize,
    /// Half the height of what the display shows, in metres.
    pub display_radius_m: f64,
    /// With what recordings begin.
    pub setup: Setup,
    /// One picture is made at a time: the turns need the cores.
    pictures: Semaphore,
    /// One upload is read at a time.
    uploads: Semaphore,
    listeners: Arc<Semaphore>,
    recordings: Arc<Semaphore>,
}

impl Door {
    /// To `hub` and what belongs to it; see the fields.
    #[expect(clippy::too_many_arguments, reason = "each is a field")]
    pub fn new(
        hub: Arc<Hub>,
        rig: Arc<Rig>,
        scenes: Arc<Library>,
        injector: Option<Injector>,
        token: Option<String>,
        listen: SocketAddr,
        upload_bytes_max: usize,
        display_radius_m: f64,
        setup: Setup,
    ) -> Arc<Self> {
        let (pictures, uploads) = (Semaphore::new(1), Semaphore::new(1));
        let [listeners, recordings] = [LISTENERS, RECORDINGS].map(|places| Arc::new(Semaphore::new(places)));
        Arc::new(Self {
            hub,
            rig,
            scenes,
            injector,
            token,
            listen,
            upload_bytes_max,
            display_radius_m,
            setup,
            pictures,
            uploads,
            listeners,
            recordings,
        })
    }
}

impl Door {
    /// A reading's refusal, with what is allowed.
    fn why(&self, refusal: tracking::Refusal) -> String {
        let Tracking { plausible_distance_m: [near, far], plausible_height_m: [low, high], .. } =
            self.rig.tracking.clone().unwrap_or_default();
        let allowed = match refusal {
            tracking::Refusal::Outside => format!("{near} to {far} m from the axis and {low} to {high} m high"),
            tracking::Refusal::TooMany => format!("{VIEWERS_MAX} at a time"),
            tracking::Refusal::Backwards => "later than what was told before".into(),
            tracking::Refusal::Jump => "no farther than a head goes meanwhile".into(),
            tracking::Refusal::Malformed | tracking::Refusal::Absurd => "numbers".into(),
        };
        format!("{}: allowed is {allowed}", refusal.name())
    }
}

/// Why a request is not answered as it wants.
#[derive(Debug)]
pub(super) struct Refusal {
    status: StatusCode,
    reason: String,
}

impl Refusal {
    fn new(status: StatusCode, reason: impl ToString) -> Self {
        Self { status, reason: reason.to_string() }
    }

    fn bad(reason: impl ToString) -> Self {
        Self::new(StatusCode::BAD_REQUEST, reason)
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.status, Json(json!({ "error": self.reason }))).into_response()
    }
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Praxinoscope",
        description = "A 360-degree light-field display: what it shows, how it does, and orders to it. Errors are {\"error\": reason}. With a \
                   token, requests carry `Authorization: Bearer TOKEN`."
    ),
    components(schemas(Place))
)]
struct Document;

/// All routes, and what they are.
fn routes(door: &Arc<Door>) -> (Router, utoipa::openapi::OpenApi) {
    let (api, document) = OpenApiRouter::with_openapi(Document::openapi())
        .nest("/api/v1", routes::all(door.upload_bytes_max))
        .split_for_parts();
    let text = document.to_pretty_json().unwrap_or_default();
    let json = [("content-type", "application/json")];
    let app = api
        .route("/openapi.json", get(move || async move { (json, text) }))
        .route("/metrics", get(routes::metrics))
        .route("/healthz", get(routes::health))
        .merge(page::routes())
        .fallback(|| async { Refusal::new(StatusCode::NOT_FOUND, "no such page: /openapi.json lists what there is") })
        .method_not_allowed_fallback(|| async {
            Refusal::new(StatusCode::METHOD_NOT_ALLOWED, "not by this method: /openapi.json lists what there is")
        })
        .layer(DefaultBodyLimit::max(routes::JSON_BYTES_MAX))
        .layer(from_fn_with_state(Arc::clone(door), guard::guard))
        .with_state(Arc::clone(door));
    (app, document)
}

/// What the interface is, as OpenAPI.
pub fn open_api(door: &Arc<Door>) -> String {
    routes(door).1.to_pretty_json().unwrap_or_default()
}

/// Answers on `listener` until the daemon ends.
pub fn serve(door: &Arc<Door>, listener: std::net::TcpListener) -> std::io::Result<()> {
    listener.set_nonblocking(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let served = runtime.block_on(async {
        let listener = TcpListener::from_std(listener)?;
        let hub = Arc::clone(&door.hub);
        let ended = async move {
            while !hub.is_stopping() {
                tokio::time::sleep(LOOK_EVERY).await;
            }
        };
        let hub = Arc::clone(&door.hub);
        let serving = axum::serve(listener, routes(door).0).with_graceful_shutdown(ended);
        let too_late = async move {
            while !hub.is_stopping() {
                tokio::time::sleep(LOOK_EVERY).await;
            }
            tokio::time::sleep(LINGER).await;
        };
        tokio::select! {
            served = serving => served,
            () = too_late => Ok(()),
        }
    });
    runtime.shutdown_timeout(LINGER);
    served
}
