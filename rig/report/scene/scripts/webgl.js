// What a small viewer needs of WebGL2 and of geometry: one program, a camera that orbits, a ray and a triangle.
{
const VERTEX = `#version 300 es
in vec3 place; in vec3 tint; in vec2 spot; uniform mat4 view; uniform float lift; out vec3 shade; out vec3 at; out vec2 where;
void main() { shade = tint; at = place; where = spot; gl_Position = view * vec4(place, 1.0); gl_Position.z -= lift * gl_Position.w; }`;
const FRAGMENT = `#version 300 es
precision highp float; in vec3 shade; in vec3 at; in vec2 where; uniform float flat_; uniform float textured; uniform sampler2D picture; out vec4 colour;
void main() {
  vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
  float lit = mix(0.72 + 0.28 * abs(dot(normal, normalize(vec3(0.4, 0.25, 0.9)))), 1.0, flat_);
  colour = vec4(mix(shade, texture(picture, where).rgb * shade, textured) * lit, 1.0);
}`;

const subtract = (a, b) => a.map((value, k) => value - b[k]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const length = Math.hypot(...a) || 1; return a.map((value) => value / length); };
const SLOPE = Math.tan(0.4);

const eyeOf = (view) => [Math.cos(view.turn) * Math.cos(view.rise), Math.sin(view.turn) * Math.cos(view.rise), Math.sin(view.rise)].map((value, k) => view.target[k] + value * view.far);
const axesOf = (view) => {
  const ahead = unit(subtract(view.target, eyeOf(view)));
  const right = unit(cross(ahead, [0, 0, 1]));
  return { ahead, right, up: cross(right, ahead) };
};

const camera = (view, aspect, size) => {
  const eye = eyeOf(view);
  const { ahead, right, up } = axesOf(view);
  const [near, far] = [Math.max(view.far * 0.01, 0.005), view.far + 3 * size];
  const [a, b] = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
  const rows = [
    [...right.map((value) => value / (SLOPE * aspect)), -dot(right, eye) / (SLOPE * aspect)],
    [...up.map((value) => value / SLOPE), -dot(up, eye) / SLOPE],
    [...ahead.map((value) => value * a), -dot(ahead, eye) * a + b],
    [...ahead, -dot(ahead, eye)],
  ];
  return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
};

const between = {
  ray: (view, x, y, aspect) => {
    const { ahead, right, up } = axesOf(view);
    return { origin: eyeOf(view), direction: unit(ahead.map((value, k) => value + x * SLOPE * aspect * right[k] + y * SLOPE * up[k])) };
  },
  // Distance to a triangle (Möller and Trumbore 1997); null beside it, or behind it where backs are not drawn.
  hit: ({ origin, direction }, a, b, c, isCulled) => {
    const [first, second] = [subtract(b, a), subtract(c, a)];
    const p = cross(direction, second);
    const determinant = dot(first, p);
    if (isCulled ? determinant < 1e-12 : Math.abs(determinant) < 1e-12) return null;
    const to = subtract(origin, a);
    const u = dot(to, p) / determinant;
    const q = cross(to, first);
    const v = dot(direction, q) / determinant;
    const distance = dot(second, q) / determinant;
    return u < 0 || v < 0 || u + v > 1 || distance <= 0 ? null : distance;
  },
  pan: (view, dx, dy, height) => {
    const { right, up } = axesOf(view);
    const step = (2 * SLOPE * view.far) / height;
    return view.target.map((value, k) => value - right[k] * dx * step + up[k] * dy * step);
  },
};

const programOf = (gl) => {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  const [place, tint, spot] = ["place", "tint", "spot"].map((name) => gl.getAttribLocation(program, name));
  const [view, flat, lift, textured] = ["view", "flat_", "lift", "textured"].map((name) => gl.getUniformLocation(program, name));
  const bind = (buffer, location, count, stride, offset) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, count, gl.FLOAT, false, stride, offset);
  };
  return {
    use: (matrix) => { gl.useProgram(program); gl.uniformMatrix4fv(view, false, matrix); },
    triangles: ({ places, tints, spots, count, isTextured }) => {
      bind(places, place, 3, 0, 0);
      bind(tints, tint, 3, 0, 0);
      bind(spots, spot, 2, 0, 0);
      gl.uniform1f(flat, 0);
      gl.uniform1f(lift, 0);
      gl.uniform1f(textured, isTextured ? 1 : 0);
      gl.drawArrays(gl.TRIANGLES, 0, count);
    },
    lines: (buffer, count) => {
      bind(buffer, place, 3, 24, 0);
      bind(buffer, tint, 3, 24, 12);
      gl.disableVertexAttribArray(spot);
      gl.uniform1f(flat, 1);
      gl.uniform1f(lift, 0.0005);
      gl.uniform1f(textured, 0);
      gl.drawArrays(gl.LINES, 0, count);
    },
  };
};

// A PNG's bytes as the texture that is drawn with; tells when it is there.
const textureOf = async (gl, base64) => {
  const bytes = Uint8Array.from(atob(base64), (one) => one.charCodeAt(0));
  const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, picture);
  for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, key, value);
};

globalThis.rigWebgl = { between, camera, programOf, textureOf };
}
