# facets and its virtual bench: docker run --rm facets simulate paper -o /tmp/paper
# Without the libraries for 3-D pictures (extra `scenes`), which would make it half as large again.
FROM python:3.13-slim AS build
COPY . /source
RUN python -m venv /opt/facets \
 && /opt/facets/bin/pip install --no-cache-dir /source \
 && find /opt/facets -depth \( -name tests -o -name __pycache__ \) -type d -exec rm -rf {} +

FROM python:3.13-slim
COPY --from=build /opt/facets /opt/facets
RUN useradd --create-home facets
USER facets
WORKDIR /home/facets
ENV PATH=/opt/facets/bin:$PATH
ENTRYPOINT ["facets"]
CMD ["--help"]
