// SPDX-License-Identifier: Apache-2.0
// The model drawn by the browser, with PlayCanvas. A camera is that of view.js.
import * as pc from './playcanvas.js';

// What PlayCanvas's shaders have otherwise than the engine: the text there, and ours.
const CORRECTIONS = {
    gsplatCornerVS: [
        // The 2D filter: PlayCanvas adds it where it measures in pixels of half the size, so to a quarter of the variance.
        ['+ 0.3;', '+ 4.0 * 0.3;'],
        // An ellipse is as large as it is.
        ['min(1024.0, min(viewport_size.x, viewport_size.y))', '1e6'],
        // Beyond 1.3 half fields of view the projection is linearised there (Kerbl et al. 2023).
        ['vec2 J2 = -J1 / vp.z * vp.xy;', `vec2 guard = 1.3 / abs(vec2(center.projMat00, center.projMat11));
            vec2 J2 = -J1 * clamp(vp.xy / vp.z, -guard, guard);`]],
    // So near nothing is drawn.
    gsplatCenterVS: [['centerView.z > 0.0', 'centerView.z > -0.2']]
};
// PlayCanvas takes the weight where it ends an ellipse, e^-4, from all weights before.
const WEIGHT = `void modifySplatColor(vec2 uv, inout vec4 color) {
    color.a = min(0.99, mix(gaussianColor.a, color.a, 1.0 - exp(-4.0)));
}`;

function correct(app, device) {
    const all = pc.ShaderChunks.get(device, pc.SHADERLANGUAGE_GLSL);
    const ours = app.scene.gsplat.material.getShaderChunks(pc.SHADERLANGUAGE_GLSL);
    for (const [name, changes] of Object.entries(CORRECTIONS))
        ours.set(name, changes.reduce((code, [theirs, text]) => {
            if (!code.includes(theirs)) throw new Error('another PlayCanvas than this page was made for');
            return code.replaceAll(theirs, text);
        }, all.get(name)));
    ours.set('gsplatModifyPS', WEIGHT);
    app.scene.gsplat.material.update();
}

// The projection of a photo's camera, off its centre too. Gaussians before `near` are not drawn.
function project(matrix, view, near, far) {
    const {width, height, fx, fy, cx, cy} = view;
    return matrix.set([2 * fx / width, 0, 0, 0, 0, 2 * fy / height, 0, 0, 1 - 2 * cx / width, 2 * cy / height - 1,
        (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
}

// Loads the model of this page. `again` is called when there is a better order of the Gaussians to draw in, `lost` where the
// browser takes the GPU away.
export async function openDrawing({background, extent}, again, lost) {
    const canvas = document.createElement('canvas');
    const device = await pc.createGraphicsDevice(canvas,
        {deviceTypes: [pc.DEVICETYPE_WEBGL2], antialias: false, depth: false, stencil: false, preserveDrawingBuffer: true});
    let fail = () => {};
    device.on('devicelost', () => {
        lost();
        fail(new Error('the GPU is gone'));
    });
    const options = new pc.AppOptions(), app = new pc.AppBase(canvas);
    Object.assign(options, {graphicsDevice: device, componentSystems: [pc.CameraComponentSystem, pc.GSplatComponentSystem],
        resourceHandlers: [pc.GSplatHandler]});
    app.init(options);
    app.autoRender = false;
    // Everything is drawn, in floating point, and each colour from where the camera is.
    Object.assign(app.scene.gsplat, {dataFormat: pc.GSPLATDATA_LARGE, minPixelSize: 0, minContribution: 0, colorUpdateAngle: 0});
    correct(app, device);

    const eye = new pc.Entity(), model = new pc.Entity();
    let view = {width: 1, height: 1, fx: 1, fy: 1, cx: .5, cy: .5};
    eye.addComponent('camera', {clearColor: new pc.Color(...background, 1), nearClip: .001 * extent, farClip: 1000 * extent,
        calculateProjection: matrix => project(matrix, view, .001 * extent, 1000 * extent)});
    app.root.addChild(eye);
    const asset = new pc.Asset('model', 'gsplat', {url: 'model.ply'});
    app.assets.add(asset);
    await new Promise((loaded, failed) => {
        asset.once('load', loaded);
        asset.once('error', failed);
        app.assets.load(asset);
    });
    model.addComponent('gsplat', {asset});
    app.root.addChild(model);

    let ready = false;
    app.systems.gsplat.on('frame:request', again);
    app.systems.gsplat.on('frame:ready', (camera, layer, done, loading) => ready = done && !loading);
    app.start();
    return {
        canvas,
        any: false, // whether the model is on the canvas
        // Draws once, in the order of the newest camera for which the Gaussians are sorted.
        async frame(camera, of, width, height) {
            const [right, down, forward] = camera.R;
            view = of;
            if (canvas.width !== width || canvas.height !== height) device.setResolution(width, height);
            eye.setPosition(...camera.c);
            eye.setRotation(new pc.Quat().setFromMat4(new pc.Mat4().set(
                [...right, 0, ...down.map(v => -v), 0, ...forward.map(v => -v), 0, 0, 0, 0, 1])));
            app.renderNextFrame = true;
            await new Promise((done, failed) => {
                fail = failed;
                app.once('frameend', done);
            });
            this.any ||= ready;
        }
    };
}
