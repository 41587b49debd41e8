// SPDX-License-Identifier: Apache-2.0
// The model drawn by the browser, with PlayCanvas. A camera is that of view.js.
import * as pc from './playcanvas.js';

// Where PlayCanvas measures ellipses: pixels of half the size of ours. Its own 0.3 would be the 2D filter of a quarter of the variance.
const FILTER = 4 * .3;

// Where PlayCanvas ends an ellipse at a weight of e^-4 it takes that from all weights before.
const WEIGHT = `void modifySplatColor(vec2 uv, inout vec4 color) {
    color.a = mix(gaussianColor.a, color.a, 1.0 - exp(-4.0));
}`;

// PlayCanvas's parts of shaders, changed so that it draws what the engine draws.
function correct(app, device) {
    const parts = app.scene.gsplat.material.getShaderChunks(pc.SHADERLANGUAGE_GLSL);
    const code = pc.ShaderChunks.get(device, pc.SHADERLANGUAGE_GLSL).get('gsplatCornerVS');
    const wider = code.replaceAll('+ 0.3;', `+ ${FILTER.toFixed(1)};`);
    if (wider === code) throw new Error('another PlayCanvas than this page was made for');
    parts.set('gsplatCornerVS', wider);
    parts.set('gsplatModifyPS', WEIGHT);
    app.scene.gsplat.material.update();
}

// The projection of a photo's camera, off its centre too. Gaussians before `near` are not drawn.
function project(matrix, view, near, far) {
    const {width, height, fx, fy, cx, cy} = view;
    return matrix.set([2 * fx / width, 0, 0, 0, 0, 2 * fy / height, 0, 0, 1 - 2 * cx / width, 2 * cy / height - 1,
        (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
}

// Loads the model of this page. `lost` is called where the browser takes the GPU away.
export async function openDrawing({background, extent}, lost) {
    const canvas = document.createElement('canvas');
    const device = await pc.createGraphicsDevice(canvas,
        {deviceTypes: [pc.DEVICETYPE_WEBGL2], antialias: false, depth: false, stencil: false, preserveDrawingBuffer: true});
    device.on('devicelost', lost);
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

    let ready = false, sorting = false;
    app.systems.gsplat.on('frame:request', () => sorting = true);
    app.systems.gsplat.on('frame:ready', (camera, layer, done, loading) => ready = done && !loading);
    app.start();
    return {
        canvas,
        any: false, // whether the model is on the canvas
        // Draws once, as well as the order of the Gaussians is known. Whether it is that of this camera.
        async frame(camera, of, width, height) {
            const [right, down, forward] = camera.R;
            view = of;
            if (canvas.width !== width || canvas.height !== height) device.setResolution(width, height);
            eye.setPosition(...camera.c);
            eye.setRotation(new pc.Quat().setFromMat4(new pc.Mat4().set(
                [...right, 0, ...down.map(v => -v), 0, ...forward.map(v => -v), 0, 0, 0, 0, 1])));
            ready = sorting = false;
            app.renderNextFrame = true;
            await new Promise((done, failed) => {
                app.once('frameend', done);
                device.once('devicelost', () => failed(new Error('the GPU is gone')));
            });
            this.any ||= ready;
            return ready && !sorting;
        }
    };
}
