// SPDX-License-Identifier: Apache-2.0
// node check.mjs TOOL FOLDER: trains a small model with TOOL, loads it in other people's software, compares every
// number, and feeds their rewriting of it back to TOOL.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { createRequire } from 'node:module';
import { mkdirSync, readFileSync, rmSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { PlyParser } from '@mkkellogg/gaussian-splats-3d';

const [tool, folder] = process.argv.slice(2);
const splatTransform = join(dirname(createRequire(import.meta.url).resolve('@playcanvas/splat-transform')),
    '../bin/cli.mjs');
const run = (...args) => execFileSync(args[0], args.slice(1), { encoding: 'utf8' });

rmSync(folder, { recursive: true, force: true });
mkdirSync(folder, { recursive: true });
const [scene, out] = [join(folder, 'scene'), join(folder, 'run')];
run(tool, 'synth', '-o', scene, '--width', '64', '--height', '48', '--train-views', '8', '--test-views', '4',
    '--points', '500', '--samples', '1');
const colmap = join(scene, 'colmap');
run(tool, 'train', colmap, '-o', out, '--iterations', '120', '--sh-interval', '20', '--quiet');
const model = join(out, 'point_cloud/iteration_120/point_cloud.ply');

// The file itself, by the names in its header: the truth that all readers must agree with.
const file = readFileSync(model);
const end = file.indexOf('end_header\n') + 11;
const header = file.subarray(0, end).toString();
const names = [...header.matchAll(/^property float (\w+)$/gm)].map((m) => m[1]);
const count = Number(header.match(/^element vertex (\d+)$/m)[1]);
assert.equal(file.length, end + 4 * names.length * count);
const values = new Float32Array(file.buffer.slice(file.byteOffset + end));
const of = (i, name) => values[i * names.length + names.indexOf(name)];
const strongest = Math.max(...Array.from({ length: 45 }, (_, k) => Math.abs(of(0, `f_rest_${k}`))));
assert.ok(strongest > 0, 'the colours of the model must depend on the direction');

// splat-transform: every value.
run('node', splatTransform, '-q', model, join(folder, 'model.csv'));
const [title, ...rows] = readFileSync(join(folder, 'model.csv'), 'utf8').trim().split('\n');
const columns = title.split(',');
assert.equal(rows.length, count);
assert.deepEqual([...columns].sort(), [...names].sort());
rows.forEach((row, i) => row.split(',').forEach((text, c) =>
    assert.equal(Math.fround(Number(text)), of(i, columns[c]), `Gaussian ${i}, ${columns[c]}`)));

// gaussian-splats-3d: what it draws from.
const near = (found, expected, slack, what) =>
    assert.ok(Math.abs(found - expected) <= slack, `${what}: found ${found}, expected ${expected}`);
const parsed = PlyParser.parseToUncompressedSplatArray(
    file.buffer.slice(file.byteOffset, file.byteOffset + file.byteLength), 2);
assert.equal(parsed.splatCount, count);
for (let i = 0; i < count; i++) {
    const s = parsed.splats[i], at = (what) => `Gaussian ${i}, ${what}`;
    const q = [0, 1, 2, 3].map((k) => of(i, `rot_${k}`)), length = Math.hypot(...q);
    ['x', 'y', 'z'].forEach((name, k) => {
        near(s[k], of(i, name), 0, at(name));
        near(s[3 + k], Math.exp(of(i, `scale_${k}`)), 1e-6 + 1e-5 * s[3 + k], at(`scale_${k}`));
        near(s[10 + k], Math.min(255, Math.max(0, 255 * (0.5 + 0.28209479 * of(i, `f_dc_${k}`)))), 1, at('colour'));
    });
    q.forEach((v, k) => near(s[6 + k], v / length, 1e-5, at(`rot_${k}`)));
    near(s[13], 255 / (1 + Math.exp(-of(i, 'opacity'))), 1, at('opacity'));
}

// And back: a model rewritten elsewhere measures the same here.
run('node', splatTransform, '-q', model, join(folder, 'back.ply'));
const score = (what) => JSON.parse(run(tool, 'eval', what, '--scene', colmap, '--json', '--quiet'));
const [ours, theirs] = [score(model), score(join(folder, 'back.ply'))];
assert.equal(theirs.psnr, ours.psnr);
assert.equal(theirs.ssim, ours.ssim);
assert.equal(theirs.gaussians, count);
console.log(`${count} Gaussians agree in splat-transform and gaussian-splats-3d; PSNR ${ours.psnr} both ways`);
