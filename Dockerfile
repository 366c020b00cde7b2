# One image for every process of the stack, and one with the tools that runs its tests.
#
#   docker compose up          builds and starts it all; see docker-compose.yml
#   docker build --target tests -t sidestep-tests .

# Give it by its digest where the same base is wanted at every build: BASE=python@sha256:...
ARG BASE=python:3.13-slim-trixie
FROM ${BASE} AS base
ENV PATH=/opt/sidestep/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    XDG_STATE_HOME=/tmp/state \
    LANG=C.UTF-8
# The directories that volumes are mounted at: a new volume takes their owner.
RUN useradd --uid 10001 --user-group --create-home --shell /usr/sbin/nologin sidestep \
    && install -d -o sidestep -g sidestep -m 0700 /recordings \
        /forge/all /forge/router /forge/plant /forge/ground /forge/record /forge/gateway \
    && install -d -m 0755 /keys /forge/robot && install -d -m 1777 /state

# The environment is made by a pip of its own, so that it ends up without one. Behind an index or a
# certificate authority of your own: PIP_CONFIG_FILE and SSL_CERT_FILE, see docker-compose.yml.
FROM base AS wanted
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1
RUN python3 -m venv /pip && python3 -m venv --without-pip /opt/sidestep
WORKDIR /source
COPY docker/install docker/runtime.txt ./
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./install -r runtime.txt

# Control core and simulation are compiled: SIDESTEP_COMPILE=0 as a build argument leaves them in
# pure Python and needs no compiler. The compiler stays in this stage.
FROM wanted AS compiler
ARG SIDESTEP_COMPILE=1
# python3-dev only for a base whose Python is that of the distribution.
RUN [ "$SIDESTEP_COMPILE" != 1 ] || { \
    headers=$(python3 -c 'import sysconfig; print(sysconfig.get_paths()["include"])')/Python.h \
    && apt-get update -qq \
    && apt-get install -y -qq --no-install-recommends gcc libc6-dev \
        $([ -e "$headers" ] || echo python3-dev) >/dev/null \
    && rm -rf /var/lib/apt/lists/*; }
COPY docker/build.txt ./
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./install --python /pip/bin/python -r build.txt

FROM compiler AS sources
COPY README.md LICENSE hatch_build.py pyproject.toml ./
COPY runtime runtime
COPY protocol protocol
COPY robot robot
COPY firmware firmware
COPY plant plant
COPY ground ground
COPY gateways gateways
COPY vehicle_check vehicle_check
COPY study study
COPY sidestep sidestep
RUN /pip/bin/python hatch_build.py sources /compiled-from

# Only what the compiler reads: another change does not compile again.
FROM compiler AS compiled
ARG SIDESTEP_COMPILE=1
COPY --from=sources /compiled-from /compiled-from
RUN mkdir /compiled && { [ "$SIDESTEP_COMPILE" != 1 ] \
    || /pip/bin/python /compiled-from/hatch_build.py compile /compiled; }

FROM sources AS built
ARG SIDESTEP_COMPILE=1
COPY --from=compiled /compiled /compiled
RUN SIDESTEP_COMPILED=/compiled /pip/bin/pip wheel --quiet --no-deps --no-build-isolation \
        --wheel-dir /wheel . \
    && /pip/bin/pip --python /opt/sidestep/bin/python install --quiet --no-deps --no-index \
        /wheel/*.whl

# For tests and measurements: the tools as well, and the tree beside them as in a checkout.
FROM wanted AS tools
COPY docker/tests.txt ./
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./install -r tests.txt \
    && cp -r /pip/lib/python3.13/site-packages/pip /opt/sidestep/lib/python3.13/site-packages/

FROM base AS tests
RUN apt-get update -qq \
    && apt-get install -y -qq --no-install-recommends make tmux >/dev/null \
    && rm -rf /var/lib/apt/lists/*
COPY --from=tools /opt/sidestep /opt/sidestep
WORKDIR /source
COPY . .
# Here and not later: a container cannot write its tree.
RUN python -m pip install --quiet --no-deps --no-build-isolation --no-index -e . \
    && python -c "from protocol.dialect.generate import oracle; oracle()"
USER 10001:10001
# The user's own shell allows no login; tmux would start it.
ENV HYPOTHESIS_STORAGE_DIRECTORY=/tmp/hypothesis SHELL=/bin/sh
ENTRYPOINT ["/source/docker/run-tests"]

# What runs loads a part of what is installed, and strip is in the compiler's stage.
FROM built AS slimmed
COPY docker/slim ./
RUN ./slim /opt/sidestep/lib/python3.13/site-packages

# The gateway to ROS 2 alone needs the libraries of its extra.
FROM slimmed AS with-ros2
COPY docker/ros2.txt ./
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./install -r ros2.txt

# The base without its documentation, translations and pip.
FROM base AS bare
RUN find /usr/share/doc -type f ! -name copyright -delete \
    && rm -rf /usr/share/man /usr/share/info /usr/share/locale /usr/share/python-wheels \
        /usr/lib/python3/dist-packages/pip* /usr/lib/python3.13/test \
        /usr/local/lib/python3.13/site-packages/pip* /usr/local/lib/python3.13/test \
        /usr/local/lib/python3.13/ensurepip /usr/local/lib/python3.13/idlelib \
        /var/cache/* /var/log/*

FROM scratch AS empty
COPY --from=bare / /
ENV PATH=/opt/sidestep/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    XDG_STATE_HOME=/tmp/state \
    LANG=C.UTF-8
COPY docker/router.toml docker/bus.toml docker/keys docker/health /etc/sidestep/
WORKDIR /home/sidestep
USER 10001:10001
ENTRYPOINT ["sidestep"]
CMD ["--help"]

FROM empty AS ros2
COPY --from=with-ros2 /opt/sidestep /opt/sidestep

FROM empty AS runtime
COPY --from=slimmed /opt/sidestep /opt/sidestep
