package localfarm

import (
	"context"
	"crypto/rand"
	"crypto/tls"
	"errors"
	"fmt"
	"net"
	"net/http"
	"net/url"

	"github.com/prometheus/client_golang/prometheus"
	"github.com/prometheus/client_golang/prometheus/collectors"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/farm"
	"metrofarm/services/internal/store"
)

// listen opens the addresses, which other coordinators are told. Where workers need certificates,
// those of this machine have an address of their own that other machines do not reach.
func (f *Farm) listen(ctx context.Context) (err error) {
	if f.farmListener, err = listen(ctx, f.options.FarmListen, "workers"); err != nil {
		return err
	}
	if f.options.Access.FarmTLS != nil && f.options.Workers > 0 {
		if f.localListener, err = listen(ctx, "127.0.0.1:0", "workers of this machine"); err != nil {
			return err
		}
	}
	if f.options.Listen != "" {
		if f.httpListener, err = listen(ctx, f.options.Listen, "the dashboard"); err != nil {
			return err
		}
		f.dashboard = f.scheme() + "://" + f.httpListener.Addr().String() + "/"
	}
	f.member = f.describe()
	return nil
}

func listen(ctx context.Context, address, purpose string) (net.Listener, error) {
	listener, err := (&net.ListenConfig{}).Listen(ctx, "tcp", address)
	if err != nil {
		return nil, fmt.Errorf("listening for %s: %w", purpose, err)
	}
	return listener, nil
}

// scheme of the REST interface.
func (f *Farm) scheme() string {
	if f.options.Access.TLS != nil {
		return "https"
	}
	return "http"
}

// describe says where other coordinators find this one.
func (f *Farm) describe() store.Member {
	m := store.Member{REST: f.options.Advertise, Farm: f.farmListener.Addr().String(), Secret: rand.Text()}
	if m.REST == "" && f.httpListener != nil {
		m.REST = f.scheme() + "://" + f.httpListener.Addr().String()
	}
	host, port, err := net.SplitHostPort(m.Farm)
	if ip := net.ParseIP(host); err == nil && ip.IsUnspecified() {
		if name := hostOf(m.REST); name != "" {
			m.Farm = net.JoinHostPort(name, port)
		}
	}
	return m
}

// hostOf a URL, without port.
func hostOf(address string) string {
	u, err := url.Parse(address)
	if err != nil {
		return ""
	}
	return u.Hostname()
}

func (f *Farm) serveWorkers(blobs *blob.Store) {
	var secure *tls.Config
	if files := f.options.Access.FarmTLS; files != nil {
		secure = files.Config()
	}
	f.serveFarm(blobs, f.farmListener, secure)
	if f.localListener != nil {
		f.serveFarm(blobs, f.localListener, nil)
	}
}

func (f *Farm) serveFarm(blobs *blob.Store, listener net.Listener, secure *tls.Config) {
	server := farm.NewServer(farm.Options{Farm: f.coordinator, Blobs: blobs, Logger: f.options.Logger, TLS: secure, Calls: f.calls})
	f.farmServers = append(f.farmServers, server)
	f.wait.Go(func() {
		if err := server.Serve(listener); err != nil {
			f.failed <- fmt.Errorf("serving workers: %w", err)
		}
	})
}

func (f *Farm) serveHTTP() error {
	if f.httpListener == nil {
		return nil
	}
	registry := prometheus.NewRegistry()
	registry.MustRegister(f.coordinator.Collector(), f.calls, buildInfo(f.options.Version), collectors.NewGoCollector(),
		collectors.NewProcessCollector(collectors.ProcessCollectorOpts{}))
	access := f.options.Access
	handler, err := api.NewHandler(api.Options{
		Service: f.farm, Scenes: f.library, Metrics: registry, Logger: f.options.Logger, Version: f.options.Version,
		Forward: f.farm.Forward, Forwarded: f.farm.Forwarded, Ready: f.coordinator.Ready,
		Tokens: access.Tokens, SessionKey: access.SessionKey, SessionTime: access.SessionTime,
		OpenMetrics: access.OpenMetrics, Limits: access.Limits,
		CheckHosts: f.options.LocalOnly || len(access.Hosts) > 0,
		Hosts:      append([]string{hostOf(f.member.REST)}, access.Hosts...), // other coordinators use the first
	})
	if err != nil {
		return err
	}
	f.httpServer = api.NewHTTPServer(handler, f.options.Logger)
	listener := f.httpListener
	if access.TLS != nil {
		listener = tls.NewListener(listener, access.TLS.Config())
	}
	f.wait.Go(func() {
		if err := f.httpServer.Serve(listener); !errors.Is(err, http.ErrServerClosed) {
			f.failed <- fmt.Errorf("serving HTTP: %w", err)
		}
	})
	return nil
}

// buildInfo tells which version serves.
func buildInfo(version string) prometheus.Collector {
	return prometheus.NewGaugeFunc(prometheus.GaugeOpts{
		Name: "metrofarm_build_info", Help: "Always 1; the version of the coordinator.",
		ConstLabels: prometheus.Labels{"version": version},
	}, func() float64 { return 1 })
}
