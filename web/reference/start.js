// Everything that the reference shows, and every script it runs, comes from the service itself.
SwaggerUIBundle({ dom_id: "#reference", url: "/openapi.json", deepLinking: true, docExpansion: "none", defaultModelsExpandDepth: -1, validatorUrl: null });
