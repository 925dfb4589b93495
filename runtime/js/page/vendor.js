// What the exported page and the tests use of three.js; build.mjs bundles it into page/three.js.
export {
    Bone, BoxGeometry, BufferAttribute, BufferGeometry, ClampToEdgeWrapping, Color, DataTexture, DirectionalLight,
    DoubleSide, FileLoader, FloatType, FrontSide, Group, HalfFloatType, InstancedMesh, LinearFilter,
    LinearMipmapLinearFilter, Loader, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, MeshPhongMaterial,
    MeshPhysicalMaterial, MeshStandardMaterial, MeshToonMaterial, MirroredRepeatWrapping, NearestFilter,
    NeutralToneMapping, NoToneMapping, Object3D, PCFShadowMap, PerspectiveCamera, PlaneGeometry, PointLight, RGBAFormat,
    RedIntegerFormat, RepeatWrapping, SRGBColorSpace, Scene, ShaderChunk, ShaderMaterial, Skeleton, SkinnedMesh,
    SpotLight, Texture, UnsignedIntType, UnsignedShortType, Vector2, Vector3, WebGLRenderTarget, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
