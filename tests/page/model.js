// A small glTF file: a bar that is not the same from two sides, with a clip that turns it.

const BOX = { least: [-1, -0.2, -0.3], most: [1, 0.4, 0.3] };

/** Corners and triangles of a box, each face with corners of its own. */
function box({ least, most }) {
  const [positions, triangles] = [[], []];
  for (const axis of [0, 1, 2]) {
    for (const side of [least, most]) {
      const first = positions.length;
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      for (const [a, b] of [[least, least], [most, least], [most, most], [least, most]]) {
        const corner = [];
        [corner[axis], corner[u], corner[v]] = [side[axis], a[u], b[v]];
        positions.push(corner);
      }
      const turn = side === most ? [0, 1, 2, 0, 2, 3] : [0, 2, 1, 0, 3, 2];
      triangles.push(...turn.map((corner) => first + corner));
    }
  }
  return { positions, triangles };
}

/** The file's bytes. */
export function model() {
  const { positions, triangles } = box(BOX);
  const half = Math.SQRT1_2;
  const parts = [
    new Float32Array(positions.flat()),
    new Uint16Array(triangles),
    new Float32Array([0, 1, 2]),
    new Float32Array([0, 0, 0, 1, 0, half, 0, half, 0, 1, 0, 0]),
  ];
  const views = [];
  let length = 0;
  for (const part of parts) {
    views.push({ buffer: 0, byteOffset: length, byteLength: part.byteLength });
    length += part.byteLength;
  }
  const document = {
    asset: { version: '2.0' },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    animations: [{
      name: 'Turn',
      samplers: [{ input: 2, output: 3 }],
      channels: [{ sampler: 0, target: { node: 0, path: 'rotation' } }],
    }],
    accessors: [
      { bufferView: 0, componentType: 5126, count: positions.length, type: 'VEC3', min: BOX.least, max: BOX.most },
      { bufferView: 1, componentType: 5123, count: triangles.length, type: 'SCALAR' },
      { bufferView: 2, componentType: 5126, count: 3, type: 'SCALAR', min: [0], max: [2] },
      { bufferView: 3, componentType: 5126, count: 3, type: 'VEC4' },
    ],
    bufferViews: views,
    buffers: [{ byteLength: length }],
  };
  return container(JSON.stringify(document), Buffer.concat(parts.map((part) => Buffer.from(part.buffer))));
}

/** JSON and binary chunks in one file. */
function container(json, binary) {
  const chunk = (kind, bytes, filler) => {
    const padded = Buffer.concat([bytes, Buffer.alloc((4 - (bytes.length % 4)) % 4, filler)]);
    const head = Buffer.alloc(8);
    head.writeUInt32LE(padded.length, 0);
    head.write(kind, 4, 'latin1');
    return Buffer.concat([head, padded]);
  };
  const chunks = Buffer.concat([chunk('JSON', Buffer.from(json), 0x20), chunk('BIN\0', binary, 0)]);
  const head = Buffer.alloc(12);
  head.write('glTF', 0, 'latin1');
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + chunks.length, 8);
  return Buffer.concat([head, chunks]);
}
