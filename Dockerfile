# One image for every process of the stack, and one with the tools that runs its tests.
#
#   docker compose up          builds and starts it all; see docker-compose.yml
#   docker build --target tests -t sidestep-tests .

FROM python:3.13-slim-trixie AS base
ENV PATH=/opt/sidestep/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    LANG=C.UTF-8
# The directories that volumes are mounted at: a new volume takes their owner.
RUN useradd --uid 10001 --user-group --create-home --shell /usr/sbin/nologin sidestep \
    && install -d -o sidestep -g sidestep -m 0700 /keys /keys/all /state /recordings

# The environment is made by a pip of its own, so that it ends up without one. Behind an index or a
# certificate authority of your own: PIP_CONFIG_FILE and SSL_CERT_FILE, see docker-compose.yml.
FROM base AS build
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_INPUT=1
RUN python3 -m venv /pip && python3 -m venv --without-pip /opt/sidestep
WORKDIR /source
COPY docker/install docker/wanted pyproject.toml constraints.txt ./
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./install /pip/bin/python hatchling editables \
    && ./wanted web >wanted.txt && ./install /opt/sidestep/bin/python -r wanted.txt
COPY README.md LICENSE sidestep.py ./
COPY protocol protocol
COPY robot robot
COPY plant plant
COPY ground ground
COPY study study
COPY benchmarks benchmarks
RUN /pip/bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir /wheel . \
    && ./install /opt/sidestep/bin/python --no-deps /wheel/*.whl

# The tests' environment has the tools as well; the tree lies beside it as in a checkout.
FROM build AS tools
RUN --mount=type=secret,id=pip_config --mount=type=secret,id=ca \
    --mount=type=cache,target=/root/.cache/pip \
    ./wanted dev >wanted.txt && ./install /opt/sidestep/bin/python hatchling editables -r wanted.txt

FROM base AS tests
RUN apt-get update -qq \
    && apt-get install -y -qq --no-install-recommends tmux >/dev/null \
    && rm -rf /var/lib/apt/lists/*
COPY --from=tools /opt/sidestep /opt/sidestep
COPY --from=tools /pip /pip
WORKDIR /source
COPY . .
ENV PYTHONPATH=/source HYPOTHESIS_STORAGE_DIRECTORY=/tmp/hypothesis
USER 10001:10001
ENTRYPOINT ["python3", "-m", "pytest", "-p", "no:cacheprovider"]
CMD ["-q", "-n", "auto", "-m", "not compose"]

FROM base AS runtime
COPY docker/router.toml docker/bus.toml /etc/sidestep/
COPY --from=build /opt/sidestep /opt/sidestep
WORKDIR /home/sidestep
USER 10001:10001
ENTRYPOINT ["sidestep"]
CMD ["--help"]
