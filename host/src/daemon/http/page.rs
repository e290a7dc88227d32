//! The page: files that are part of the program.

use super::Door;
use axum::Router;
use axum::response::IntoResponse;
use axum::routing::get;
use std::sync::Arc;

const FILES: [(&str, &str, &str); 12] = [
    ("/", "text/html; charset=utf-8", include_str!("../page/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../page/page.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../page/icon.svg")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../page/page.js")),
    ("/daemon.js", "text/javascript; charset=utf-8", include_str!("../page/daemon.js")),
    ("/parts.js", "text/javascript; charset=utf-8", include_str!("../page/parts.js")),
    ("/viewer.js", "text/javascript; charset=utf-8", include_str!("../page/viewer.js")),
    ("/state.js", "text/javascript; charset=utf-8", include_str!("../page/state.js")),
    ("/controls.js", "text/javascript; charset=utf-8", include_str!("../page/controls.js")),
    ("/scenes.js", "text/javascript; charset=utf-8", include_str!("../page/scenes.js")),
    ("/plots.js", "text/javascript; charset=utf-8", include_str!("../page/plots.js")),
    ("/recording.js", "text/javascript; charset=utf-8", include_str!("../page/recording.js")),
];

/// Nothing from elsewhere is loaded, run or embedded.
const POLICY: &str =
    "default-src 'self'; img-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

pub(super) fn routes() -> Router<Arc<Door>> {
    FILES.iter().fold(Router::new(), |router, (path, kind, text)| {
        let headers = [
            ("content-type", *kind),
            ("content-security-policy", POLICY),
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cache-control", "no-cache"),
        ];
        router.route(path, get(move || async move { (headers, *text).into_response() }))
    })
}

/// Whether `path` is part of the page, which anybody may see: it asks for the token.
pub(super) fn is_part(path: &str) -> bool {
    FILES.iter().any(|(file, ..)| *file == path)
}
