import { readFileSync } from "node:fs";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import * as fzstd from "fzstd";

// Print the number of messages of each topic, and the positions of one topic of odometry, as JSON.
const [file, odom] = process.argv.slice(2);
const data = readFileSync(file);
const readable = {
  size: async () => BigInt(data.length),
  read: async (offset, size) => data.subarray(Number(offset), Number(offset) + Number(size)),
};
const decompressHandlers = { zstd: (packed, size) => fzstd.decompress(packed, new Uint8Array(Number(size))) };
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const readers = new Map(), counts = {}, places = [];
for await (const one of reader.readMessages()) {
  const channel = reader.channelsById.get(one.channelId);
  if (!readers.has(channel.id)) {
    const schema = reader.schemasById.get(channel.schemaId);
    const text = new TextDecoder().decode(schema.data);
    readers.set(channel.id, new MessageReader(parse(text, { ros2: true })));
  }
  const message = readers.get(channel.id).readMessage(one.data);
  counts[channel.topic] = (counts[channel.topic] ?? 0) + 1;
  if (channel.topic === odom) places.push([message.pose.pose.position.x, message.pose.pose.position.y]);
}
console.log(JSON.stringify({ profile: reader.header.profile, counts, places }));
