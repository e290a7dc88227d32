//! A simulated controller that other programs talk to.

use crate::desk::Desk;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};

/// A server, which ends with this.
struct Server {
    child: Child,
    said: BufReader<ChildStdout>,
}

impl Server {
    fn start() -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(["sim", "--serve", "usb", "--listen", "127.0.0.1:0", "--json"]).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let said = BufReader::new(child.stdout.take().unwrap());
        Self { child, said }
    }

    /// The next thing that happens, which is `event`.
    fn hears(&mut self, event: &str) -> Value {
        let mut line = String::new();
        self.said.read_line(&mut line).unwrap();
        let value: Value = serde_json::from_str(&line).unwrap();
        assert_eq!(value["event"], event, "{line}");
        value
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The first message of a USB/IP client that wants the device of that name.
fn request(name: &str) -> Vec<u8> {
    let mut request = vec![1, 0x11, 0x80, 3, 0, 0, 0, 0];
    request.extend(name.bytes());
    request.resize(40, 0);
    request
}

/// [`request`] as a client sends it, and what it is answered: code and status.
fn import(address: &str, name: &str) -> (TcpStream, Vec<u8>) {
    let mut client = TcpStream::connect(address).unwrap();
    client.write_all(&request(name)).unwrap();
    let mut answer = vec![0; 8];
    client.read_exact(&mut answer).unwrap();
    (client, answer)
}

#[test]
fn a_usb_device_is_attached_by_one_host_at_a_time() {
    let mut server = Server::start();
    let ready = server.hears("ready");
    let address = ready["address"].as_str().unwrap();
    Desk::new().refuses(&format!("sim --serve usb --listen {address}"), &[address, "listens there already"]);
    let (mut first, given) = import(address, "1-1");
    assert_eq!(given, [1, 0x11, 0, 3, 0, 0, 0, 0]);
    server.hears("attached");
    assert_eq!(import(address, "1-1").1[7], 2);
    // Its device descriptor, asked for by CMD_SUBMIT on endpoint 0.
    first.read_exact(&mut [0; 312]).unwrap();
    let words = [1u32, 7, 0x10002, 1, 0, 0, 18, 0, 0, 0];
    let mut submit: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
    submit.extend([0x80, 6, 0, 1, 0, 0, 18, 0]);
    first.write_all(&submit).unwrap();
    let mut answer = [0; 48 + 18];
    first.read_exact(&mut answer).unwrap();
    assert_eq!((answer[3], answer[7], &answer[48 + 8..48 + 12]), (3, 7, &[0x09, 0x12, 0x01, 0x00][..]));
    drop(first);
    server.hears("left");
    assert_eq!(import(address, "1-1").1[7], 0);
    server.hears("attached");
}

#[test]
fn a_client_that_says_nothing_holds_up_nobody() {
    let mut server = Server::start();
    let address = server.hears("ready")["address"].as_str().unwrap().to_string();
    let mut silent = TcpStream::connect(&address).unwrap();
    let (_given, answer) = import(&address, "1-1");
    assert_eq!(answer[7], 0);
    server.hears("attached");
    // Now it speaks, and is told that the device is taken.
    silent.write_all(&request("1-1")).unwrap();
    let mut answer = [0; 8];
    silent.read_exact(&mut answer).unwrap();
    assert_eq!(answer[7], 2);
    assert_eq!(crate::devices::ended(&mut server.child), Some(0), "also while a host has it");
}

#[test]
fn a_client_that_vanishes_is_said_to_have_done_so() {
    let mut server = Server::start();
    let address = server.hears("ready")["address"].as_str().unwrap().to_string();
    let (mut client, _) = import(&address, "1-1");
    server.hears("attached");
    // All that it was sent, or its end would be none in order.
    client.read_exact(&mut [0; 312]).unwrap();
    client.write_all(&[0; 5]).unwrap();
    drop(client);
    let left = server.hears("left");
    assert!(left["why"].as_str().unwrap().contains("the client went away"), "{left}");
}

#[test]
fn what_cannot_be_served_is_refused() {
    let desk = Desk::new();
    desk.refuses("sim --serve usb --listen nowhere", &["--listen", "nowhere"]);
    desk.refuses("sim --serve usb --key none.pub", &["none.pub"]);
    desk.refuses("sim --listen 127.0.0.1:3240", &["--serve"]);
}
