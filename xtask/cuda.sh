#!/bin/sh
# Builds jostle for GPUs of NVIDIA's without an installed CUDA toolkit: its compiler and libraries come
# from Python's package index into a folder. Needs python3 with pip, a C compiler and cargo; neither root nor a GPU.
#
#   sh xtask/cuda.sh FOLDER CAPABILITY [JOBS]
#
# FOLDER      where the toolkit goes (1.2 GB); one that is there already is used again
# CAPABILITY  the GPU's compute capability without its point: 80, 86, 89, 90 …
# JOBS        compilers at a time (default 1: each takes some gigabytes)
set -eu

if [ $# -lt 2 ]; then
    echo "usage: sh xtask/cuda.sh FOLDER CAPABILITY [JOBS]" >&2
    exit 2
fi
capability=$2
jobs=${3:-1}
workspace=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)

# The versions that fit together and that candle 0.11.1 was built with.
if [ ! -e "$folder/complete" ]; then
    python3 -m pip install --quiet --no-deps --upgrade --target "$folder" \
        nvidia-cuda-nvcc==13.0.88 nvidia-nvvm==13.0.88 nvidia-cuda-crt==13.0.88 \
        nvidia-cuda-cccl==13.0.85 nvidia-cuda-runtime==13.0.96 nvidia-cuda-nvrtc==13.0.88 \
        nvidia-curand nvidia-cublas==13.1.0.3
    touch "$folder/complete"
fi

# The packages put all of it into one folder per major version.
root=$(find "$folder" -type f -name nvcc -path '*/bin/nvcc' | head -n 1)
root=${root%/bin/nvcc}
if [ -z "$root" ]; then
    echo "found no bin/nvcc under $folder, expected the compiler of the package nvidia-cuda-nvcc" >&2
    exit 1
fi
chmod +x "$root"/bin/* "$root"/nvvm/bin/* 2>/dev/null || true

# What a linker and an installed toolkit expect: lib64, and libX.so beside libX.so.N.
[ -e "$root/lib64" ] || ln -s lib "$root/lib64"
for library in "$root"/lib/lib*.so.*; do
    plain=${library%%.so.*}.so
    [ -e "$plain" ] || ln -s "$(basename "$library")" "$plain"
done

# The driver's library is only there where a driver is; to link, one with its name is enough that has a function of it: a library
# without any that is asked for would be left out of what the program loads. The other functions are found when it starts.
if [ ! -e "$root/lib/libcuda.so" ]; then
    mkdir -p "$root/lib/stubs"
    printf '%s\n' 'int cuInit(unsigned int flags) { (void)flags; return 100; }' \
        'int cuDeviceGet(int *device, int ordinal) { (void)device; (void)ordinal; return 100; }' > "$folder/stub.c"
    cc -shared -fPIC -Wl,-soname,libcuda.so.1 -o "$root/lib/stubs/libcuda.so" "$folder/stub.c"
fi

export CUDA_ROOT="$root" CUDA_PATH="$root" CUDA_HOME="$root" CUDA_COMPUTE_CAP="$capability"
export PATH="$root/bin:$PATH"
export LIBRARY_PATH="$root/lib:$root/lib/stubs${LIBRARY_PATH:+:$LIBRARY_PATH}"
export RUSTFLAGS="-L native=$root/lib -L native=$root/lib/stubs -C link-arg=-Wl,--allow-shlib-undefined -C link-arg=-Wl,--unresolved-symbols=ignore-all ${RUSTFLAGS:-}"
cd "$workspace"
cargo build --release --jobs "$jobs" --target-dir target/cuda -p jostle-cli -p xtask \
    --features jostle-cli/cuda,xtask/cuda

echo "built target/cuda/release/jostle and target/cuda/release/xtask; before they are started:"
echo "export LD_LIBRARY_PATH=$root/lib\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH}"
