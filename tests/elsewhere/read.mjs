// Reads a recording with the library of MCAP's authors for TypeScript, by its index, and checks each
// message: node read.mjs NODE_MODULES RECORDING; the findings are JSON.
import fs from "node:fs"
import { createRequire } from "node:module"

const [folder, path] = process.argv.slice(2)
const require = createRequire(`${folder}/any.js`)
const { McapIndexedReader } = require("@mcap/core")
const { loadDecompressHandlers } = require("@mcap/support")
const foxglove = require("@foxglove/schemas/jsonschema.js")
const { Ajv } = require("ajv")

const file = fs.openSync(path)
const readable = {
  size: async () => BigInt(fs.fstatSync(file).size),
  read: async (offset, size) => {
    const bytes = new Uint8Array(Number(size))
    fs.readSync(file, bytes, 0, Number(size), Number(offset))
    return bytes
  },
}
const decompressHandlers = await loadDecompressHandlers()
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers })
const ajv = new Ajv({ strict: false })
const checks = new Map()
const found = { messages: {}, wrong: [], checkedByFoxglove: 0, outOfOrder: 0 }

function checksOf(channel) {
  const schema = reader.schemasById.get(channel.schemaId)
  const mine = ajv.compile(JSON.parse(new TextDecoder().decode(schema.data)))
  const name = schema.name.startsWith("foxglove.") ? schema.name.slice(9) : undefined
  return [mine, ...(name ? [ajv.compile(foxglove[name])] : [])]
}

let before = 0n
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId)
  const { topic } = channel
  found.messages[topic] = (found.messages[topic] ?? 0) + 1
  found.outOfOrder += message.logTime < before ? 1 : 0
  before = message.logTime
  if (!checks.has(topic)) {
    checks.set(topic, checksOf(channel))
  }
  const data = JSON.parse(new TextDecoder().decode(message.data))
  for (const [k, check] of checks.get(topic).entries()) {
    found.checkedByFoxglove += k
    if (!check(data) && found.wrong.length < 10) {
      found.wrong.push(`${topic}: ${JSON.stringify(check.errors)}`)
    }
  }
}
found.chunks = reader.chunkIndexes.length
found.counted = Number(reader.statistics.messageCount)
console.log(JSON.stringify(found))
