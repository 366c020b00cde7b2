// Carry MAVLink between a vehicle and the standard streams by node-mavlink, a JSON line per message.
// Arguments: udpout or tcp, host, port. NaN is null in JSON.
"use strict";

const dgram = require("node:dgram");
const net = require("node:net");
const readline = require("node:readline");
const { PassThrough } = require("node:stream");
const {
  MavLinkPacketParser,
  MavLinkPacketSplitter,
  MavLinkProtocolV2,
  ardupilotmega,
  common,
  minimal,
} = require("node-mavlink");

const GROUND_STATION = [255, 190];
const [transport, host, port] = process.argv.slice(2);
const registry = { ...minimal.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY };
const byName = new Map(Object.values(registry).map((one) => [one.MSG_NAME, one]));
const protocol = new MavLinkProtocolV2(...GROUND_STATION);
const received = new PassThrough();
let sequence = 0;

function connected() {
  if (transport === "tcp") {
    const stream = net.connect(Number(port), host);
    stream.setNoDelay(true);
    stream.pipe(received);
    return (data) => stream.write(data);
  }
  const socket = dgram.createSocket("udp4");
  socket.on("message", (data) => received.write(data));
  return (data) => socket.send(data, Number(port), host);
}

function print(packet) {
  const type = registry[packet.header.msgid];
  if (type === undefined) return;
  const data = packet.protocol.data(packet.payload, type);
  const fields = Object.fromEntries(type.FIELDS.map((one) => [one.source, data[one.name]]));
  const { sysid, compid, seq } = packet.header;
  const line = { name: type.MSG_NAME, system: sysid, component: compid, sequence: seq, fields };
  const plain = (_, value) => (typeof value === "bigint" ? Number(value) : value);
  process.stdout.write(`${JSON.stringify(line, plain)}\n`);
}

function built({ name, fields }) {
  const type = byName.get(name);
  const message = new type();
  for (const one of type.FIELDS) {
    const value = fields[one.source];
    if (value === undefined) continue;
    message[one.name] = /int64/.test(one.type) ? BigInt(value) : (value ?? NaN);
  }
  return message;
}

const send = connected();
received.pipe(new MavLinkPacketSplitter()).pipe(new MavLinkPacketParser()).on("data", print);
readline
  .createInterface({ input: process.stdin })
  .on("line", (line) => {
    send(protocol.serialize(built(JSON.parse(line)), sequence));
    sequence = (sequence + 1) & 0xff;
  })
  .on("close", () => process.exit(0));
