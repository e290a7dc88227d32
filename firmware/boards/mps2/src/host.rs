//! The host's end of the wire by a serial port, for whoever has no simulator in between: it may watch, command and stream as over USB.
//! What it says arrives whenever this machine gets to it; runs that must repeat bring it by lockstep.

use crate::{HOST, with_session};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use firmware::lockstep::Said;

/// How often the controller reports, by the machine's own time.
const REPORT: Duration = Duration::from_millis(10);

/// Answers every packet by one, and reports to a host that has said anything here.
#[embassy_executor::task]
pub async fn host() {
    let mut somebody = false;
    let mut report_at = Instant::MIN;
    loop {
        let said = match select(HOST.read(), Timer::at(report_at)).await {
            Either::First(byte) => {
                somebody = true;
                let heard = with_session(|session| session.hear(&mut &[byte][..])).flatten();
                heard.and_then(|(said, _)| Said::from_slice(&said).ok())
            }
            Either::Second(()) => {
                report_at = Instant::from_ticks(Instant::now().as_ticks().saturating_add(REPORT.as_ticks()));
                somebody.then(|| with_session(|session| session.report())).flatten()
            }
        };
        HOST.write(&said.unwrap_or_default()).await;
    }
}
