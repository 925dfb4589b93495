/** Builds the exported scene: triangles, materials and lights as gsgi's own renderer draws them, shadows by three.js. */

import * as THREE from "three";
import { ENVIRONMENT, LIGHT, SHADOW } from "./shaders.js";

const SHADOW_SIZE = 2048; // texels; half of it for each face of a cube
const NEAR = 1e-3; // of a light's reach; nearer things throw no shadow
const MAPS = 4, LIGHT_MAPS = 3; // textures of a material, and of the baked light
const BITMAP = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
const WRAP = { repeat: THREE.RepeatWrapping, mirror: THREE.MirroredRepeatWrapping, clamp: THREE.ClampToEdgeWrapping };

/** Materials that draw depth alone, by side; the offset lets the surfaces themselves pass the depth test. */
const DEPTH = Object.fromEntries([THREE.FrontSide, THREE.DoubleSide].map((side) => [side, new THREE.MeshBasicMaterial(
    { side, colorWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 })]));

/** Whether B alone is shown: a uniform of all materials. */
export const onlyIndirect = { value: false };

function replace(chunk, pattern, text) {
    const before = THREE.ShaderChunk[chunk], after = before.replaceAll(pattern, text);
    if (before === after) throw new Error(`three.js has changed: ${chunk} has no ${pattern}`);
    THREE.ShaderChunk[chunk] = after;
}

/** Makes three.js light Lambertian materials by the formulas of glsl/frame. All materials of the page are such. */
function patchShaders() {
    // Attenuation of glTF's lights.
    replace("lights_pars_begin", "float getDistanceAttenuation(", `${LIGHT}\nfloat unusedDistanceAttenuation(`);
    replace("lights_pars_begin", /getDistanceAttenuation\( (\w+), (\w+\.distance), \w+\.decay \)/g,
        "gsgi_range_attenuation( $1, $2 > 0.0 ? 1.0 / $2 : 0.0 )");
    replace("lights_pars_begin", /getSpotAttenuation\( (\w+\.coneCos), (\w+\.penumbraCos), angleCos \)/g,
        "gsgi_cone_attenuation( angleCos, $2, $1 )");

    // Normals are turned to the side of the triangle that faces the camera, whichever way they point in the file.
    replace("normal_fragment_begin", /[^]+/g, `
        float faceDirection = gl_FrontFacing ? 1.0 : -1.0;
        pageFace = normalize( cross( dFdx( vViewPosition ), dFdy( vViewPosition ) ) );
        vec3 normal = normalize( vNormal );
        float side = dot( normal, pageFace ) < 0.0 ? -1.0 : 1.0;
        #ifdef USE_NORMALMAP_TANGENTSPACE
            mat3 tbn = side * mat3( normalize( vTangent ), normalize( vBitangent ), normal );
        #endif
        normal *= side;
        vec3 nonPerturbedNormal = normal;
    `);
    replace("normal_pars_fragment", "#ifndef FLAT_SHADED", "vec3 pageFace;\n#ifndef FLAT_SHADED");
    replace("lights_lambert_pars_fragment", "saturate( dot( geometryNormal, directLight.direction ) )",
        "saturate( dot( geometryNormal, directLight.direction ) ) * step( 1e-6, dot( pageFace, directLight.direction ) )");

    // Shadows: the receiver is lifted off its triangle, as in glsl/frame/shadow.glsl. A light's shadowNormalBias holds
    // the edge of a texel, in m for directional lights, per metre of distance for others.
    replace("shadowmap_pars_fragment", "#ifdef USE_SHADOWMAP", `
        #ifdef USE_SHADOWMAP
        #if NUM_DIR_LIGHT_SHADOWS > 0
            uniform mat4 directionalShadowMatrix[ NUM_DIR_LIGHT_SHADOWS ];
        #endif
        #if NUM_SPOT_LIGHT_COORDS > 0
            uniform mat4 spotLightMatrix[ NUM_SPOT_LIGHT_COORDS ];
        #endif
        #if NUM_POINT_LIGHT_SHADOWS > 0
            uniform mat4 pointShadowMatrix[ NUM_POINT_LIGHT_SHADOWS ];
        #endif
        ${SHADOW}
        vec4 lifted( vec3 wi, float texel ) {
            vec3 lift = gsgi_shadow_lift( texel, dot( pageFace, wi ), length( vViewPosition ) ) * pageFace + texel * wi;
            return vec4( ( vec4( lift - vViewPosition - viewMatrix[ 3 ].xyz, 0.0 ) * viewMatrix ).xyz, 1.0 );
        }
    `);
    const lifted = (kind, distance) =>
        `lifted( directLight.direction, ${kind}LightShadow.shadowNormalBias * ${distance} )`;
    const away = (kind) => lifted(kind, `length( ${kind}Light.position - geometryPosition )`);
    replace("lights_fragment_begin", "vDirectionalShadowCoord[ i ]",
        `directionalShadowMatrix[ i ] * ${lifted("directional", "1.0")}`);
    replace("lights_fragment_begin", "spotLightShadow.shadowRadius, vSpotLightCoord[ i ]",
        `spotLightShadow.shadowRadius, spotLightMatrix[ i ] * ${away("spot")}`);
    replace("lights_fragment_begin", "vPointShadowCoord[ i ]", `pointShadowMatrix[ i ] * ${away("point")}`);

    // A metal part reflects nothing, where the bake says so; its texture comes in the place of a specular map.
    replace("specularmap_fragment", /[^]+/g, `
        #ifdef METALLIC
            float metallic = METALLIC;
            #ifdef USE_SPECULARMAP
                metallic *= texture2D( specularMap, vSpecularMapUv ).b;
            #endif
            diffuseColor.rgb *= 1.0 - metallic;
        #endif
        float specularStrength = 1.0;
    `);
    replace("lights_pars_begin", "uniform bool receiveShadow;", "uniform bool receiveShadow;\nuniform bool onlyIndirect;");
    replace("aomap_fragment", /[^]+/g, `
        #ifdef LAMBERT
            const vec3 none = vec3( 0.0 );
            #ifdef UNLIT
                reflectedLight = ReflectedLight( none, none, diffuseColor.rgb, none );
            #endif
            if ( onlyIndirect ) {
                totalEmissiveRadiance = none;
                reflectedLight = ReflectedLight( none, none, irradiance * RECIPROCAL_PI, none );
            }
        #endif
    `);
}

/** The bytes of a file beside the page; `progress(bytes)` hears of each part that has come. */
export async function fetchBytes(name, progress = () => {}) {
    const response = await fetch(name);
    if (!response.ok) throw new Error(`${name}: ${response.status} ${response.statusText}`);
    const parts = [];
    for (const reader = response.body.getReader(); ; ) {
        const { done, value } = await reader.read();
        if (done) break;
        parts.push(value);
        progress(value.length);
    }
    return new Blob(parts);
}

/**
 * The three.js scene of scene.json, whose `triangles` come as a promised Blob and other files from `fetchOne(name)` as
 * further ones, a scene `depth` of its opaque triangles, which drawn first keeps what is hidden from looking up its light, and the meshes that are `blended`.
 *
 * Its textures show their mean until `loadImages(changed)` has read them; that calls `changed()` after each.
 */
export async function buildScene(description, triangles, fetchOne, renderer) {
    patchShaders();
    const scene = new THREE.Scene(), depth = new THREE.Scene(), blended = [];
    const [data, environment, ...images] = await Promise.all([
        triangles.then((blob) => blob.arrayBuffer()),
        description.environment && fetchOne(description.environment.file).then((blob) => blob.arrayBuffer()),
        ...description.images.map(({ mean }) => createImageBitmap(new ImageData(Uint8ClampedArray.from(mean), 1, 1))),
    ]);
    const textures = description.images.map(() => []); // of each image
    const dimmers = []; // (group, function of its weight) for each light
    const dimmable = (group, set) => { if (group !== undefined) dimmers.push([group, set]); };
    const materials = description.materials.map((each) => material(each, description, images, textures, renderer));
    description.materials.forEach(({ group, emission }, i) => dimmable(group, (weight) =>
        materials[i].emissive?.setRGB(...emission).multiplyScalar(weight)));
    for (const each of description.meshes) {
        const made = new THREE.Mesh(geometry(each, data), materials[each.material]), { transparent } = made.material;
        made.castShadow = !transparent; // light meets the stand-ins instead
        made.receiveShadow = true;
        scene.add(made);
        if (transparent) blended.push(centred(made));
        else if (!made.material.alphaTest && made.material.colorWrite)
            depth.add(new THREE.Mesh(made.geometry, DEPTH[made.material.side]));
    }
    const limit = renderer.capabilities.maxTextures - MAPS - LIGHT_MAPS;
    const shadowed = description.lights.slice(0, limit);
    for (const each of description.lights) {
        const made = addLight(scene, each, description.bounds, shadowed.includes(each));
        dimmable(each.group, (weight) => made.color.setRGB(...each.color).multiplyScalar(weight));
    }
    if (environment) {
        const made = sky(description.environment, environment);
        scene.add(made);
        dimmable(description.environment.group, (weight) => { made.material.uniforms.weight.value = weight; });
    }
    /** Multiplies what lights give directly by the weights of their groups. */
    const dim = (weights) => { for (const [group, set] of dimmers) set(weights[group]); };

    const loadImage = async ({ file }, i) => {
        const bitmap = await createImageBitmap(await fetchOne(file), BITMAP);
        for (const texture of textures[i]) {
            texture.dispose(); // which has the size of the mean
            Object.assign(texture, { image: bitmap, needsUpdate: true });
        }
    };
    const loadImages = (changed) =>
        Promise.all(description.images.map((image, i) => loadImage(image, i).then(changed)));
    return { scene, depth, blended, loadImages, dim, unshadowed: description.lights.length - shadowed.length };
}

function geometry({ attributes, index }, data) {
    const made = new THREE.BufferGeometry();
    for (const [name, { offset, size, count }] of Object.entries(attributes))
        made.setAttribute(name, new THREE.BufferAttribute(new Float32Array(data, offset, size * count), size));
    return made.setIndex(new THREE.BufferAttribute(new Uint32Array(data, index.offset, index.count), 1));
}

/** The mesh with its origin in its middle, by which three.js sorts what it blends. */
function centred(mesh) {
    mesh.geometry.computeBoundingBox();
    mesh.geometry.boundingBox.getCenter(mesh.position);
    mesh.geometry.translate(...mesh.position.clone().negate());
    return mesh;
}

function material(each, description, images, textures, renderer) {
    const texture = (slot, color) => {
        if (!slot) return null;
        const { image, wrap, nearest } = description.textures[slot.texture];
        const made = new THREE.Texture(images[image], undefined, WRAP[wrap[0]], WRAP[wrap[1]]);
        made.magFilter = nearest ? THREE.NearestFilter : THREE.LinearFilter;
        made.minFilter = nearest ? THREE.NearestFilter : THREE.LinearMipmapLinearFilter;
        made.generateMipmaps = !nearest;
        made.anisotropy = nearest ? 1 : Math.min(4, renderer.capabilities.getMaxAnisotropy());
        const colorSpace = color ? THREE.SRGBColorSpace : "";
        textures[image].push(made);
        return Object.assign(made, { flipY: false, channel: slot.uv, colorSpace, needsUpdate: true });
    };
    const shape = {
        name: each.name, opacity: each.alpha, map: texture(each.map, true), alphaTest: each.alphaCutoff ?? 0,
        vertexColors: each.colored, side: each.doubleSided ? THREE.DoubleSide : THREE.FrontSide,
        shadowSide: THREE.DoubleSide,
    };
    if (each.standIn) return new THREE.MeshBasicMaterial({ ...shape, colorWrite: false, depthWrite: false });
    const made = new THREE.MeshLambertMaterial({
        ...shape, color: new THREE.Color(...each.color), transparent: each.blended, depthWrite: !each.blended,
        emissive: new THREE.Color(...each.emission), emissiveMap: texture(each.emissionMap, true),
        normalMap: texture(each.normalMap, false), normalScale: new THREE.Vector2(each.normalScale, each.normalScale),
        specularMap: texture(each.metallicMap, false),
    });
    made.defines = each.unlit ? { UNLIT: "" } : each.metallic ? { METALLIC: each.metallic.toFixed(6) } : {};
    made.onBeforeCompile = (shader) => { shader.uniforms.onlyIndirect = onlyIndirect; };
    return made;
}

/** Lights, with shadow maps over what they reach of the scene, which lies in `bounds`. */
function addLight(scene, { kind, color, position, direction, range, cosInner, cosOuter }, bounds, shadowed) {
    const distance = range ?? 0, corners = [];
    for (let i = 0; i < 8; ++i) corners.push(new THREE.Vector3(...[0, 1, 2].map((k) => bounds[i >> k & 1][k])));
    const light = {
        point: () => new THREE.PointLight(0, 1, distance, 2),
        spot: () => {
            const outer = Math.acos(cosOuter), made = new THREE.SpotLight(0, 1, distance, outer);
            made.penumbra = 1 - Math.acos(cosInner) / outer;
            return made;
        },
        directional: () => new THREE.DirectionalLight(0, 1),
    }[kind]();
    light.color.setRGB(...color);
    light.position.set(...position);
    const towards = direction && new THREE.Vector3(...direction);
    const { shadow } = light, size = kind === "point" ? SHADOW_SIZE / 2 : SHADOW_SIZE;
    shadow.mapSize.set(size, size);
    shadow.radius = 0;
    shadow.bias = 0;
    if (kind === "directional") {
        const middle = new THREE.Vector3(...bounds[0]).add(new THREE.Vector3(...bounds[1])).multiplyScalar(0.5);
        const half = corners[0].distanceTo(middle);
        light.position.copy(middle).addScaledVector(towards, -1.01 * half);
        Object.assign(shadow.camera, { left: -half, right: half, bottom: -half, top: half, near: 0, far: 2.02 * half });
        shadow.normalBias = 2 * half / size;
    } else {
        const reach = Math.max(...corners.map((corner) => corner.distanceTo(light.position))) * 1.001;
        const far = distance ? Math.min(reach, distance) : reach;
        Object.assign(shadow.camera, { near: NEAR * far, far });
        shadow.normalBias = 2 * (kind === "spot" ? Math.min(Math.tan(light.angle), 100) : 1) / size;
    }
    shadow.camera.updateProjectionMatrix();
    light.castShadow = shadowed;
    scene.add(light);
    if (light.target) scene.add(light.target);
    light.target?.position.copy(light.position).add(towards);
    return light;
}

/** The environment behind everything, texel by texel as glsl/frame/background.frag shows it. */
function sky({ width, height, rotation }, bytes) {
    const texture = new THREE.DataTexture(new Uint16Array(bytes), width, height, THREE.RGBAFormat, THREE.HalfFloatType);
    texture.needsUpdate = true;
    const material = new THREE.ShaderMaterial({
        uniforms: {
            environment: { value: texture }, rotation: { value: rotation }, weight: { value: 1 },
            world_from_clip: { value: new THREE.Matrix4() },
        },
        vertexShader: `
            out vec4 far;
            uniform mat4 world_from_clip;
            void main() {
                gl_Position = vec4( position.xy, 1.0, 1.0 );
                far = world_from_clip * gl_Position;
            }`,
        fragmentShader: `
            ${ENVIRONMENT}
            uniform highp sampler2D environment;
            uniform float rotation;
            uniform float weight;
            in vec4 far;
            void main() {
                vec3 direction = far.xyz / far.w - cameraPosition;
                ivec2 texel = gsgi_environment_texel( direction, rotation, textureSize( environment, 0 ) );
                gl_FragColor = vec4( weight * texelFetch( environment, texel, 0 ).rgb, 1.0 );
                #include <tonemapping_fragment>
                #include <colorspace_fragment>
            }`,
        depthWrite: false,
    });
    const mesh = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material);
    Object.assign(mesh, { frustumCulled: false, renderOrder: 1, name: "sky" });
    mesh.onBeforeRender = (_renderer, _scene, camera) => material.uniforms.world_from_clip.value
        .multiplyMatrices(camera.matrixWorld, camera.projectionMatrixInverse);
    return mesh;
}
