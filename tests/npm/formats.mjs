// SPDX-License-Identifier: Apache-2.0
// node formats.mjs TOOL FOLDER: files of TOOL in other people's software and theirs in TOOL, value by value.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { createRequire } from 'node:module';
import { mkdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { PlyParser, SplatBufferGenerator } from '@mkkellogg/gaussian-splats-3d';
import createSpz from '@adobe/spz';

const [tool, folder] = process.argv.slice(2);
const splatTransform = join(dirname(createRequire(import.meta.url).resolve('@playcanvas/splat-transform')),
    '../bin/cli.mjs');
const run = (...args) => execFileSync(args[0], args.slice(1), { encoding: 'utf8' });
const at = (name) => join(folder, name);

rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
run(tool, 'synth', '-o', at('scene'), '--width', '64', '--height', '48', '--train-views', '8', '--test-views', '4',
    '--points', '500', '--samples', '1');
run(tool, 'train', at('scene/colmap'), '-o', at('run'), '--iterations', '200', '--sh-interval', '20', '--quiet');
const model = join(at('run'), 'point_cloud/iteration_200/point_cloud.ply');

// A model as a map from property to values, from our PLY and from their CSV.
const ply = (path) => {
    const file = readFileSync(path);
    const end = file.indexOf('end_header\n') + 11;
    const header = file.subarray(0, end).toString();
    const names = [...header.matchAll(/^property float (\w+)$/gm)].map((m) => m[1]);
    const count = Number(header.match(/^element vertex (\d+)$/m)[1]);
    const values = new Float32Array(file.buffer.slice(file.byteOffset + end, file.byteOffset + file.length));
    return Object.fromEntries(names.map((name, k) =>
        [name, Float32Array.from({ length: count }, (_, i) => values[i * names.length + k])]));
};
const csv = (path) => {
    const [title, ...rows] = readFileSync(path, 'utf8').trim().split('\n');
    const names = title.split(','), cells = rows.map((row) => row.split(',').map(Number));
    return Object.fromEntries(names.map((name, k) => [name, cells.map((row) => row[k])]));
};

// Every value of two readings of one file; of quaternions the rotation, whose signs and lengths may differ.
const sigmoid = (x) => 1 / (1 + Math.exp(-x));
const same = (ours, theirs, what) => {
    const names = Object.keys(theirs).filter((name) => !/^n[xyz]$|^rot_/.test(name));
    const count = theirs.x.length;
    assert.equal(ours.x.length, count, what);
    for (const name of names)
        for (let i = 0; i < count; i++) {
            const [a, b] = name === 'opacity' ? [sigmoid(ours[name][i]), sigmoid(theirs[name][i])]
                : [ours[name][i], theirs[name][i]];
            // An opacity byte of 0 or 255 has no finite logit: readers choose one near the end.
            const slack = name === 'opacity' ? 0.0011 : 2e-5 + 1e-5 * Math.abs(b);
            assert.ok(Math.abs(a - b) <= slack, `${what}: Gaussian ${i}, ${name}: ours ${a}, theirs ${b}`);
        }
    for (let i = 0; i < count; i++) {
        const [p, q] = [ours, theirs].map((m) => [0, 1, 2, 3].map((k) => m[`rot_${k}`][i]));
        const cos = Math.abs(p.reduce((sum, v, k) => sum + v * q[k], 0)) / Math.hypot(...p) / Math.hypot(...q);
        // antimatter15 maps bytes of .splat by (b - 128) / 128; splat-transform's map is half a step beside it.
        assert.ok(cos > 1 - (/\.splat$/.test(what) ? 1e-4 : 1e-5), `${what}: Gaussian ${i}: rotations ${p} and ${q}`);
    }
    return names.length;
};
const compare = (name) => { // both read one file
    run('node', splatTransform, '-q', at(name), at(`${name}.csv`));
    run(tool, 'convert', at(name), at(`${name}.ours.ply`), '-q');
    const values = same(ply(at(`${name}.ours.ply`)), csv(at(`${name}.csv`)), name);
    console.log(`${name}: ${values} properties agree`);
};

// Our files in their readers.
for (const name of ['ours.splat', 'ours.compressed.ply', 'ours.sog'])
    run(tool, 'convert', model, at(name), '-q');
for (const version of [2, 3, 4])
    run(tool, 'convert', model, at(`ours-${version}.spz`), '--spz-version', `${version}`, '-q');
['ours.splat', 'ours.compressed.ply', 'ours.sog', 'ours-2.spz', 'ours-3.spz', 'ours-4.spz'].forEach(compare);

// Their files in our readers. splat-transform writes no .spz of version 2, so spz itself writes these.
run('node', splatTransform, '-q', model, at('theirs.compressed.ply'));
run('node', splatTransform, '-q', '-g', 'cpu', model, at('theirs.sog'));
run('node', splatTransform, '-q', model, at('theirs-4.spz'));
const spz = await createSpz();
const cloud = await spz.loadSpzFromBuffer(readFileSync(at('ours-3.spz')), { to: spz.CoordinateSystem.RDF });
for (const version of [2, 3])
    writeFileSync(at(`theirs-${version}.spz`), await spz.saveSpzToBuffer(cloud,
        { version, from: spz.CoordinateSystem.RDF, sh1Bits: 5, shRestBits: 4 }));
const file = readFileSync(model);
for (const level of [0, 1, 2]) {
    const splats = PlyParser.parseToUncompressedSplatArray(
        file.buffer.slice(file.byteOffset, file.byteOffset + file.byteLength), 2);
    const buffer = SplatBufferGenerator.getStandardGenerator(0, level, 0).generateFromUncompressedSplatArray(splats);
    writeFileSync(at(`theirs-${level}.ksplat`), new Uint8Array(buffer.bufferData));
}
['theirs.compressed.ply', 'theirs-2.spz', 'theirs-3.spz', 'theirs-4.spz', 'theirs-0.ksplat', 'theirs-1.ksplat',
    'theirs-2.ksplat', 'theirs.sog'].forEach(compare);

// .glb: no reader there, so both write one.
const glb = (path) => {
    const bytes = readFileSync(path), view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    assert.equal(view.getUint32(8, true), bytes.length);
    const length = view.getUint32(12, true), json = JSON.parse(bytes.subarray(20, 20 + length).toString());
    const body = 28 + length;
    assert.equal(view.getUint32(20 + length, true), json.buffers[0].byteLength);
    assert.equal(json.asset.version, '2.0');
    const primitive = json.meshes[0].primitives[0];
    return { extension: primitive.extensions, mode: primitive.mode, used: json.extensionsUsed,
        attributes: Object.fromEntries(Object.entries(primitive.attributes).map(([name, k]) => {
            const a = json.accessors[k], v = json.bufferViews[a.bufferView], start = body + (v.byteOffset ?? 0);
            const data = bytes.subarray(start, start + v.byteLength);
            return [name, { type: a.type, min: a.min, max: a.max, values: a.componentType === 5126
                ? new Float32Array(data.buffer.slice(data.byteOffset, data.byteOffset + data.length)) : data }];
        })) };
};
// Quaternions x y z w that turn an ellipsoid the same way: up to a half turn about one of its own axes.
const sameShape = (p, q) => {
    const [x, y, z, w] = p;
    return [[x, y, z, w], [w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]].some((turned) =>
        Math.abs(turned.reduce((sum, v, k) => sum + v * q[k], 0)) > (1 - 1e-5) * Math.hypot(...p) * Math.hypot(...q));
};
run(tool, 'convert', model, at('ours.glb'), '-q');
run('node', splatTransform, '-q', model, at('theirs.glb'));
const [ours, theirs] = [glb(at('ours.glb')), glb(at('theirs.glb'))];
assert.deepEqual([ours.extension, ours.mode, ours.used], [theirs.extension, theirs.mode, theirs.used]);
assert.deepEqual(Object.keys(ours.attributes).sort(), Object.keys(theirs.attributes).sort());
for (const [name, a] of Object.entries(theirs.attributes)) {
    const b = ours.attributes[name];
    assert.deepEqual([b.type, b.values.length], [a.type, a.values.length]);
    const rotation = name.endsWith('ROTATION');
    for (let i = 0; i < a.values.length; i++) {
        if (rotation && i % 4)
            continue;
        const near = rotation ? sameShape(a.values.subarray(i, i + 4), b.values.subarray(i, i + 4))
            : Math.abs(a.values[i] - b.values[i]) <= (name === 'COLOR_0' ? 1 : 1e-5 + 1e-4 * Math.abs(a.values[i]));
        assert.ok(near, `glb: ${name} ${i}: ours ${b.values[i]}, theirs ${a.values[i]}`);
    }
    for (let k = 0; k < 3 && a.min; k++)
        assert.ok(Math.abs(a.min[k] - b.min[k]) + Math.abs(a.max[k] - b.max[k]) < 1e-5, 'bounds of positions');
}
console.log(`glb: ${Object.keys(ours.attributes).length} attributes agree`);
