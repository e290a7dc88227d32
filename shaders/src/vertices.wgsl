// Every vertex in every instance.

@group(0) @binding(1) var<storage, read> slices: array<Slice>;
@group(0) @binding(3) var<storage, read> positions: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> projected: array<Vertex>;
@group(0) @binding(5) var<storage, read_write> refused: atomic<u32>;

// As on the CPU, vertices beyond this are not drawn.
const FAR_PX = 1e6;
// Beyond this, fixed point in 32 bits ends.
const FIXED_PX = 16000.0;

@compute @workgroup_size(64)
fn vertices(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.x + id.y * groups.x * 64u;
    if index >= batch.vertices {
        return;
    }
    let instance = id.z;
    let slice = slices[instances[instance].optics];
    var vertex = vertex_of(slice, positions[index].xyz);
    let distance = max(abs(vertex.pixel.x), abs(vertex.pixel.y));
    if (vertex.state & UNSURE) != 0u || (FIXED_PX <= distance && distance < FAR_PX) {
        atomicAdd(&refused, 1u);
    }
    if (vertex.state & UNSURE) != 0u || distance >= FIXED_PX {
        vertex.state = NOWHERE;
    }
    projected[instance * batch.vertices + index] = vertex;
}
