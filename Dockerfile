# The package with its kernels compiled: `docker build -t dirprim .`, then `docker run --rm -v "$PWD:/data" dirprim demo`.
FROM python:3.12-slim
COPY . /src
RUN pip install --no-cache-dir uv && uv pip install --system --no-cache "/src[geo,remote,fleet]" && rm -r /src
ENV NUMBA_CACHE_DIR=/var/cache/dirprim
RUN mkdir -m 777 $NUMBA_CACHE_DIR && dirprim doctor --compile && chmod -R a+rwX $NUMBA_CACHE_DIR
WORKDIR /data
ENTRYPOINT ["dirprim"]
CMD ["demo"]
